"""The node of ROS 2: it publishes joints and health, and takes nothing.

It is a client of the Zenoh router of ROS 2: it listens nowhere, and connects to nothing else. Zenoh
itself connects again when the router was gone, and declares the tokens again.
"""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress

import zenoh

from ecatd.base.daemon_threads import in_daemon_thread
from ecatd.base.errors import EcatError
from ecatd.base.log import Log
from ecatd.client import Client
from ecatd.config.ros import RosConfig
from ecatd.operations.zenoh_keys import session_config

from .health import statuses
from .joints import Joints
from .messages import DIAGNOSTICS, diagnostic_array, joint_states
from .rmw import RosNode, Topic, attachment, gid

_TRY_MS = 1000
"""Most milliseconds of a try to reach the router."""
_PAUSE = 1.0
"""Seconds between two tries, and between two messages about health."""
_CLOSE_PATIENCE = 1.0


class Node:
    """The node of one bus.

    Args:
        bus: Name of the bus.
        config: The configuration.
        log: The log.
    """

    def __init__(self, bus: str, config: RosConfig, log: Log) -> None:
        self._bus = bus
        self._config = config
        self._log = log
        self._client: Client | None = None
        self._joints: Joints | None = None
        self._reported: list[str] = []  # what is wrong

    async def run(self) -> None:
        """Publishes until it is cancelled."""
        session = await self._open()
        try:
            node = RosNode(
                self._config.domain_id,
                str(session.zid()),
                self._config.namespace,
                self._config.node,
            )
            token = session.liveliness().declare_token(node.token)
            diagnostics = _Publisher(session, node, 1, DIAGNOSTICS)
            states = None
            if self._config.joint:
                states = _Publisher(session, node, 2, joint_states(self._config.namespace))
            await asyncio.gather(
                self._look_after(session),
                self._publish_health(diagnostics),
                self._publish_joints(states),
            )
            del token  # until here, it must not be collected
        finally:
            with suppress(TimeoutError):
                await asyncio.wait_for(in_daemon_thread(session.close), _CLOSE_PATIENCE)

    async def _open(self) -> zenoh.Session:
        """Opens the session: tries until there is a router."""
        settings = {
            "connect/endpoints": [self._config.connect],
            "connect/timeout_ms": _TRY_MS,
            "connect/exit_on_failure": True,
        }
        is_reported = False
        while True:
            try:
                return await in_daemon_thread(
                    lambda: zenoh.open(session_config("client", settings))
                )
            except zenoh.ZError:
                if not is_reported:
                    self._log.warning(self._no_router())
                is_reported = True
            await asyncio.sleep(_PAUSE)

    def _no_router(self) -> str:
        return (
            f"no Zenoh router of ROS 2 is reached at {self._config.connect} (ros.connect); ecatd "
            "keeps trying, and the bus goes on"
        )

    async def _look_after(self, session: zenoh.Session) -> None:
        """Logs when the router is reached, and when it is lost, or is none."""
        was_there = None
        while True:
            is_there = bool(session.info.routers_zid())
            if is_there and not was_there:
                self._log.info(f"ROS 2 is reached by its router at {self._config.connect}")
            elif is_there != was_there:
                self._log.warning(self._no_router())
            was_there = is_there
            await asyncio.sleep(_PAUSE)

    async def _publish_health(self, publisher: _Publisher) -> None:
        while True:
            slaves = []
            if self._client is not None:
                with suppress(EcatError):  # the status of the bus says it
                    slaves = self._client.slaves()
            found = statuses(self._bus, slaves, self._joints if self._config.joint else None)
            publisher.put(diagnostic_array(time.time_ns(), found))
            await asyncio.sleep(_PAUSE)

    async def _publish_joints(self, publisher: _Publisher | None) -> None:
        while True:
            try:
                with Client(self._bus) as client:
                    joints = Joints(client, self._config.joint)
                    self._report(joints.problems)
                    self._client, self._joints = client, joints
                    await self._stream(client, joints, publisher)
            except EcatError as error:
                self._report([f"no joints for ROS 2: {error}"])
            finally:
                self._client = self._joints = None
            await asyncio.sleep(_PAUSE)

    def _report(self, problems: list[str]) -> None:
        """Logs what is wrong, once while it stays so."""
        for text in problems:
            if text not in self._reported:
                self._log.warning(text)
        self._reported = problems

    async def _stream(self, client: Client, joints: Joints, to: _Publisher | None) -> None:
        """Publishes joints until the daemon ends, or is another one."""
        loop, instance, last_cycle = asyncio.get_running_loop(), client.instance, -1
        due, period = loop.time(), 1 / self._config.rate_hz if to else _PAUSE
        while client.instance == instance:
            client.sample()
            if to and client.cycle != last_cycle and (state := joints.state()) is not None:
                to.put(state.encode())
            last_cycle = client.cycle
            due = max(due + period, loop.time())
            await asyncio.sleep(due - loop.time())


class _Publisher:
    """A publisher of the node, with its token."""

    def __init__(self, session: zenoh.Session, node: RosNode, number: int, topic: Topic) -> None:
        token = node.publisher_token(number, topic)
        self._gid = gid(token)
        self._sequence = 0
        self._publisher = session.declare_publisher(
            topic.key(node.domain_id),
            congestion_control=zenoh.CongestionControl.DROP,
            reliability=zenoh.Reliability.RELIABLE,
        )
        self._token = session.liveliness().declare_token(token)

    def put(self, message: bytes) -> None:
        """Publishes a message."""
        self._sequence += 1
        self._publisher.put(
            message, attachment=attachment(self._sequence, time.time_ns(), self._gid)
        )
