"""The gateway: Zenoh on one side, the bus server's control socket on the other."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, cast

import zenoh

from ecatd.base.daemon_threads import in_daemon_thread
from ecatd.base.errors import EcatError, NotPermittedError, UnreachableError, UsageError
from ecatd.base.log import Log
from ecatd.base.log_levels import DEFAULTS
from ecatd.base.paths import control_socket, remove_zenoh_socket, write_host, zenoh_socket
from ecatd.base.timeouts import Timeout
from ecatd.config import Config, GatewayConfig, UserConfig, read_config
from ecatd.description.bus import Bus
from ecatd.description.bus_reader import read_bus
from ecatd.operations.bus import ReadConfig, ReadRights, ReadStates, Rights
from ecatd.operations.bus_client import Answer, BusClient
from ecatd.operations.description import Describe
from ecatd.operations.encoding import MAX_MESSAGE, pack, unpack
from ecatd.operations.endpoints import LOCAL, Endpoint
from ecatd.operations.handlers import Handlers, handles
from ecatd.operations.log import ReadLogLevels
from ecatd.operations.operation import Operation, needs_right, on_behalf
from ecatd.operations.outputs import HoldOutputs, Outputs, ReadOutputs
from ecatd.operations.query import from_query
from ecatd.operations.statistics import Clocks, ReadClocks, ReadStats, Statistics
from ecatd.operations.zenoh_keys import AS, SCHEMA, bus_key, full_name, session_config
from ecatd.shm.contents import read_outputs
from ecatd.shm.statistics import read, to_map
from ecatd.shm.statistics.clocks import read_clocks

from .access import (
    Rate,
    Refusals,
    access_control,
    certificates,
    check,
    rights,
    too_many,
    unknown_slaves,
    without_encryption,
)
from .admission import RELAYED, Admission
from .certificates import contents, watch_certificates, wrong_certificates
from .history import Histories
from .listening import Listening
from .metrics import MetricsServer
from .publisher import Publisher, publish_stats
from .replies import IS_HERE, TAKEN_WITHIN_S, Replies
from .routers import watch_routers
from .sessions import Sessions
from .streams import Streams
from .traces import Traces

_OPEN_PATIENCE, _OPEN_PAUSE = Timeout(5.0), 0.005
"""Seconds that Zenoh has to listen on the local socket, and seconds between two looks."""
_LOOK_PATIENCE, _LOOK_AGAIN = 1.0, 0.1
"""Seconds for an answer when the gateway looks whether clients get one, and between two looks."""
_WAIT_KEY = "transport/link/tx/queue/congestion_control/block/wait_before_close"
_RECEIVED_MAX = 2 * MAX_MESSAGE
"""Most bytes of a message that Zenoh puts together: it does so before anybody knows the sender's
rights. A longer one is dropped, and one of half the length is told that it is too long."""
_SECTIONS = ("bus", "gateway", "realtime")
"""What the gateway uses of the configuration."""

_LOCAL = "somebody on this machine"
"""How the log names a user of the Unix socket."""


class Gateway:
    """Answers queries and publishes events of one bus.

    Args:
        name: Name of the bus.
        runtime_dir: The folder with the folders of the sockets.
        log: The log for failures.
        on_end: Called when the bus server has gone, or the settings or certificates have changed,
            so that another gateway must be started.
    """

    def __init__(self, name: str, runtime_dir: Path, log: Log, on_end: Callable[[], None]) -> None:
        self._name = self._full_name = name
        self._log = log
        self._on_end = on_end
        self._runtime_dir = runtime_dir
        self._socket = zenoh_socket(runtime_dir, name)
        self._bus = BusClient(control_socket(runtime_dir, name), self._on_event, on_end)
        self._config = self._in_use = GatewayConfig()
        self._sessions: Sessions | None = None
        self._admission: Admission | None = None
        self._metrics: MetricsServer | None = None
        self._streams: Streams | None = None
        self._traces: Traces | None = None
        self._tasks: set[asyncio.Task[Any]] = set()
        self._rates: dict[str, Rate] = {}
        self._refusals = Refusals(log)
        self._handlers = Handlers()  # until the sessions are open
        self._description: Answer | None = None
        self._packed: tuple[Answer, bytes] | None = None
        self._slaves: dict[str, Any] = {}  # the last bus description
        self._named = Bus(name, 0)  # has slaves if the rights of users name some

    async def connect(self) -> Config:
        """Connects to the bus server, reads the settings, and makes the folder for the sockets.

        Returns:
            The configuration of the bus server.

        Raises:
            EcatError: The bus server does not answer, or the folder cannot be made.
        """
        await self._bus.open()
        config = await self._settings()
        self._config = config.gateway
        old = os.umask(0)
        try:
            self._socket.parent.mkdir(mode=0o750, exist_ok=True)
        except OSError as error:
            text = f"cannot make {self._socket.parent}: {error.strerror}"
            raise NotPermittedError(text) from error
        finally:
            os.umask(old)
        return config

    async def _settings(self) -> Config:
        given = (await self._bus.ask(ReadConfig()))["config"]
        # The rest is not for the gateway, and would take a while for a large bus.
        config = read_config({key: given[key] for key in _SECTIONS if key in given})
        levels = (await self._bus.ask(ReadLogLevels()))["levels"]
        self._log.levels = {**DEFAULTS, **levels}
        return config

    async def start(self) -> None:
        """Opens the Zenoh session and starts to answer. Call `connect` before.

        Raises:
            EcatError: The session cannot be opened, or the bus server does not answer.
        """
        in_use, files = self._config, contents(self._config)
        if wrong := wrong_certificates(in_use):
            in_use = without_encryption(in_use)
            self._log.error(f"{wrong}. Until this is corrected, encrypted addresses cannot be used")
        if self._config.certificate or self._config.users_ca:
            watching = watch_certificates(self._config, files, self._log, self._on_end)
            self._keep(asyncio.create_task(watching))
        self._in_use = in_use
        self._full_name = full_name(in_use.host, self._name)
        await self._look_at_slaves()
        for text in unknown_slaves(in_use, self._named):
            self._log.warning(text)
        zenoh.init_log_from_env_or("off")
        listening = Listening(in_use.listen, self._log)
        await listening.look()
        self._sessions = sessions = await self._open_sessions()
        self._keep(asyncio.create_task(listening.watch()))
        self._keep(asyncio.create_task(watch_routers(sessions.network, in_use, self._log)))
        self._streams = Streams(sessions, self._name, self._full_name)
        self._traces = Traces(sessions, self._bus, self._name, self._full_name, self._log)
        histories = Histories(self._bus, self._name)
        self._handlers = Handlers(self, self._streams, self._traces, histories)
        loop = asyncio.get_running_loop()

        def receive(query: zenoh.Query, replies: Replies) -> None:
            with suppress(RuntimeError):  # the gateway ends
                loop.call_soon_threadsafe(self._receive, query, replies)

        for part in ("ro", "rw", AS):
            key = bus_key(self._full_name, part, "**")
            sessions.serve(key, receive)
        sessions.be_alive(bus_key(self._full_name, "alive"))
        if address := self._config.metrics:
            self._metrics = MetricsServer(
                address, self._name, lambda: self._bus.ask(ReadStates()), self._log
            )
            await self._metrics.start()
        publisher = Publisher(
            sessions, self._name, self._full_name, self._config.publish_hz, self._log
        )
        self._keep(asyncio.create_task(publisher.run()))
        stats = publish_stats(sessions, self._name, self._full_name)
        self._keep(asyncio.create_task(stats))

    def _keep(self, task: asyncio.Task[Any]) -> None:
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _open_sessions(self) -> Sessions:
        """Opens the Zenoh sessions; `access.py` says who may do what.

        Raises:
            UnreachableError: Zenoh does not open it, or does not listen on the local socket.
        """
        remove_zenoh_socket(self._runtime_dir, self._name)
        write_host(self._runtime_dir, self._name, self._in_use.host)
        listen, connect = self._in_use.listen, self._in_use.connect
        protocols = {item: Endpoint.of(item).protocol for item in listen}
        local = [item for item in listen if protocols[item] == LOCAL]
        self._admission = admission = Admission(self._in_use, self._log)
        others = [item for item in listen if protocols[item] not in (*RELAYED, LOCAL)]
        remote = [*admission.endpoints, *others]
        old = os.umask(0o117)
        try:
            here = [f"{LOCAL}/{self._socket}", *local]
            sessions = [zenoh.open(self._session_config(here, []))]
            deadline = time.monotonic() + _OPEN_PATIENCE.seconds
            while not self._socket.exists():
                if time.monotonic() > deadline:
                    raise UnreachableError(
                        f"Zenoh does not listen on {self._socket} within {_OPEN_PATIENCE}"
                    )
                await asyncio.sleep(_OPEN_PAUSE)
            if remote or connect:
                limits = {"transport/unicast/max_sessions": admission.sessions_max + len(connect)}
                network = self._session_config(remote, connect, limits)
                sessions.append(zenoh.open(network))
        except zenoh.ZError as error:
            raise UnreachableError(f"Zenoh does not open: {_reason(error)}") from error
        finally:
            os.umask(old)
        if admission.endpoints:
            sessions[-1].info.declare_link_events_listener(admission.on_link)
            await asyncio.to_thread(admission.start)
        return Sessions(sessions)

    def _session_config(
        self, endpoints: list[str], connect: list[str], limits: dict[str, Any] | None = None
    ) -> zenoh.Config:
        return session_config(
            "peer",
            {
                "transport/link/rx/max_message_size": _RECEIVED_MAX,
                _WAIT_KEY: int(TAKEN_WITHIN_S * 1e6),
                "listen/endpoints": endpoints,
                # Zenoh tries an address again that does not exist yet, and uses the others already.
                "listen/timeout_ms": -1,
                "listen/exit_on_failure": False,
                "connect/endpoints": connect,
                "connect/timeout_ms": -1,
                "connect/exit_on_failure": False,
                "access_control": access_control(self._full_name, self._in_use),
                **certificates(self._in_use),
                **(limits or {}),
            },
        )

    def _receive(self, query: zenoh.Query, replies: Replies) -> None:
        """Starts to answer a query; the reply is sent when the bus server has answered."""
        begin = time.monotonic()
        IS_HERE.set(replies.are_here)  # of this call, and what it starts
        parts = str(query.key_expr).split("/")[3:]  # those that follow the name of the bus
        try:
            answer = self._carry_out(query, parts)
        except Exception as error:
            answer = asyncio.get_running_loop().create_future()
            answer.set_exception(error)
        answer.add_done_callback(partial(self._reply, query, replies, parts, begin))

    def _reply(
        self,
        query: zenoh.Query,
        replies: Replies,
        parts: list[str],
        begin: float,
        answer: Answer,
    ) -> None:
        if self._sessions is None:  # it is being closed, so there is no way to reply
            answer.exception()  # else asyncio complains that the exception was never retrieved
            return
        if self._log.writes_debug:
            how = answer.exception() or "answered"
            took_ms = 1e3 * (time.monotonic() - begin)
            self._log.debug(f"{str(query.selector)!r}: {how} after {took_ms:.1f} ms")
        try:
            content = self._pack(answer)
            # The query may be for all buses, so the answer says which one this is.
            send = partial(query.reply, bus_key(self._full_name, *parts), content)
        except EcatError as error:
            content = pack({"schema": SCHEMA, "error": error.to_reply()})
            send = partial(query.reply_err, content)
        except Exception as error:
            # A defect in one answer must not stop the gateway. The caller gets an error.
            self._log.error(f"defect while answering {query.key_expr}: {error!r}")
            reply = EcatError(f"defect in the gateway: {error!r}").to_reply()
            content = pack({"schema": SCHEMA, "error": reply})
            send = partial(query.reply_err, content)
        replies.send(partial(_send, query, send))

    def _pack(self, answer: Answer) -> bytes:
        """Packs an answer; that with the description, which may be large, is kept like it."""
        if answer is not self._description:
            return pack({"schema": SCHEMA, **answer.result()})
        if self._packed is None or self._packed[0] is not answer:
            self._packed = answer, pack({"schema": SCHEMA, **answer.result()})
        return self._packed[1]

    def _carry_out(self, query: zenoh.Query, parts: list[str]) -> Answer:
        payload = b"" if query.payload is None else bytes(query.payload)
        if len(payload) > MAX_MESSAGE:
            raise UsageError(f"a request of {len(payload)} bytes is too long")
        user = None
        if parts[:1] == [AS] and parts[2:3] == ["rw"]:
            user, parts = self._user(parts[1]), parts[2:]
        values = unpack(payload) if payload else {}
        identity = values.pop("id", None)
        request = from_query(parts, str(query.parameters), values)
        if isinstance(request, Describe):
            return self._describe()
        if type(request) in self._handlers:
            return asyncio.ensure_future(self._handlers.answer(request))
        if not needs_right(type(request)):
            return self._bus.ask(request)
        who = _LOCAL
        if user is not None:
            try:
                check(user, request, self._named)
            except NotPermittedError as error:
                self._refusals.note(user.name, f"{error}; asked for {'/'.join(parts)}")
                raise
            who = f"user '{user.name}'"
            if request.is_change:
                delay = self._rates.setdefault(user.name, Rate(user)).delay()
                if delay > 0 and isinstance(request, HoldOutputs):
                    raise too_many(user)  # a value that comes late is worse than none
                if delay > 0:
                    request = on_behalf(request, who)
                    return asyncio.ensure_future(self._later(delay, user, identity, request))
        return self._once(user, identity, on_behalf(request, who))

    async def _later(
        self, delay: float, user: UserConfig, identity: Any, request: Operation[Any]
    ) -> dict[str, Any]:
        await asyncio.sleep(delay)
        return await self._once(user, identity, request)

    def _describe(self) -> Answer:
        """The bus description. A large one takes a while, so it is kept until it changes."""
        kept = self._description
        if kept is None or (kept.done() and kept.exception() is not None):
            self._description = kept = self._bus.ask(Describe())
        return kept

    async def _look_at_slaves(self) -> bool:
        """Reads the bus description; returns whether it has changed."""
        before, self._slaves = self._slaves, await asyncio.shield(self._describe())
        if any(user.slaves for user in self._in_use.user):
            self._named = read_bus(self._slaves, "the bus server", strict=False)
        return self._slaves != before

    def _user(self, name: str) -> UserConfig:
        for user in self._in_use.user:
            if user.name == name:
                return user
        raise NotPermittedError(f"user '{name}' is not in the configuration of the daemon")

    @handles(ReadStats)
    def _read_stats(self, request: ReadStats) -> Statistics:
        return cast("Statistics", to_map(read(self._name), buckets=request.buckets))

    @handles(ReadClocks)
    def _read_clocks(self, _: ReadClocks) -> Clocks:
        return read_clocks(self._name)

    @handles(ReadOutputs)
    async def _read_outputs(self, request: ReadOutputs) -> Outputs:
        return await asyncio.to_thread(lambda: read_outputs(self._name, names=request.names))

    @handles(ReadRights)
    def _read_rights(self, request: ReadRights) -> Rights:
        return rights(self._user(request.user))

    def _once(self, user: UserConfig | None, identity: Any, request: Operation[Any]) -> Answer:
        """Carries out a change; the answer is the earlier one if its id has come before."""
        if not isinstance(identity, str) or not 1 <= len(identity) <= 64:
            raise UsageError("a change needs an 'id': a text of 1 to 64 characters, new each time")
        if type(request).is_repeatable:
            return self._bus.ask(request)
        return self._bus.ask(request, (user.name if user else "", identity))

    def _on_event(self, event: dict[str, Any]) -> None:
        if "line" in event:
            self._publish("log/lines", event["line"])
            return
        if event["event"] in ("configuration", "log_levels"):
            self._keep(asyncio.create_task(self._reconfigure()))
        self._publish("event", event)

    def _publish(self, what: str, content: dict[str, Any]) -> None:
        if self._sessions is not None:
            key = bus_key(self._full_name, "ro", what)
            self._sessions.put(key, pack({"schema": SCHEMA, **content}))

    async def _reconfigure(self) -> None:
        """Reads what may have changed; calls `on_end` if another gateway must be started.

        That is so if its settings have changed.
        """
        self._description = None  # the limits of outputs may have changed
        with suppress(UnreachableError):  # the bus server has ended
            if await self._look_at_slaves():
                self._publish("slaves", self._slaves)
            if (await self._settings()).gateway != self._config:
                self._on_end()

    async def report(self) -> dict[str, Any]:
        """Returns the answer to the service's ping: it is empty, since it is enough that it comes.

        It comes only if clients get answers: the gateway finds its bus as a new one does, over its
        socket.
        """
        while not await in_daemon_thread(self._finds_itself):
            await asyncio.sleep(_LOOK_AGAIN)
        return {}

    def _finds_itself(self) -> bool:
        try:
            settings = {
                "connect/endpoints": [f"{LOCAL}/{self._socket}"],
                "connect/timeout_ms": int(_LOOK_PATIENCE * 1e3),
                "connect/exit_on_failure": True,
            }
            # A session that is open says nothing about those that cannot open one.
            with zenoh.open(session_config("client", settings)) as client:
                key = bus_key(self._full_name, "alive")
                found = client.liveliness().get(key, timeout=_LOOK_PATIENCE)
                return any(reply.ok is not None for reply in found)
        except zenoh.ZError:
            return False

    async def stop(self) -> None:
        """Closes the session and the connection."""
        for task in list(self._tasks):
            task.cancel()
        self._refusals.close()
        if self._metrics is not None:
            self._metrics.close()
        if self._streams is not None:
            self._streams.close()
        if self._traces is not None:
            self._traces.close()
        self._bus.close()
        if self._admission is not None:
            self._admission.close()
        sessions, self._sessions = self._sessions, None
        if sessions is not None:
            await asyncio.to_thread(sessions.close)
        remove_zenoh_socket(self._runtime_dir, self._name)


def _send(query: zenoh.Query, send: Callable[[], None]) -> None:
    """Sends the reply to a query, unless its client has gone."""
    with query, suppress(zenoh.ZError):
        send()


def _reason(error: Exception) -> str:
    """Returns the text of a Zenoh error without its positions in Zenoh's sources."""
    return str(error).split(" at /")[0]
