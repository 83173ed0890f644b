"""Requests to a daemon over Zenoh: what `ecatctl` and programs on other hosts use."""

from __future__ import annotations

import os
import time
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import zenoh

from ecatd.encoding import MAX_REPLY, pack, unpack
from ecatd.model.bus_name import check_bus_name
from ecatd.model.errors import (
    JOIN,
    EcatError,
    NoAnswerError,
    NotPermittedError,
    UnreachableError,
    UsageError,
)
from ecatd.model.messages import (
    DescribeObject,
    ListObjects,
    ReadErrors,
    ReadEvents,
    ReadFrames,
    ReadIdn,
    ReadInfo,
    ReadLogLevels,
    ReadRegister,
    ReadSii,
    ReadStates,
    Request,
    Rescan,
    ResetErrors,
    SdoRead,
    SdoWrite,
    SetLogLevel,
    SetState,
    StartFoe,
    WriteIdn,
    WriteRegister,
    WriteSii,
)
from ecatd.model.queries import to_query
from ecatd.paths import search_dirs, zenoh_socket
from ecatd.units import how_to_start
from ecatd.zenoh_keys import AS, RIGHTS, bus_key, session_config

from .identity import find_identity, is_encrypted, whose

# What only some requests need is loaded by them: most commands are one request, and short.
if TYPE_CHECKING:
    from ecatd.model.bus import Bus
    from ecatd.model.config import Config
    from ecatd.model.dictionary import DictionaryObject
    from ecatd.model.idns import IdnValue
    from ecatd.model.port_errors import SlaveErrors
    from ecatd.stats import Snapshot

    from .file_transfer import FileTransfer
    from .stream import Stream

_SII_PART = 64
"""Words of an EEPROM that one request reads: the size of the smallest one. Other requests wait
meanwhile, for some milliseconds."""

_GATEWAY_PATIENCE, _GATEWAY_PAUSE = 5.0, 0.05
"""Seconds for which a gateway is waited for that starts while the bus runs, and between tries."""


class SdoValue(NamedTuple):
    """Data of an object, and what the daemon knows about it.

    Attributes:
        data: As it was uploaded or downloaded: little endian.
        name: Name of the object, or empty.
        data_type: Its CoE data type index; where nobody knows it, an unsigned type of that size, or
            OCTET_STRING.
        unit: Unit of the physical value, or empty.
        scale: Physical value = value * scale + offset.
        offset: See `scale`; in `unit`.
    """

    data: bytes
    name: str = ""
    data_type: int = 0
    unit: str = ""
    scale: float = 1.0
    offset: float = 0.0


def _local_endpoint(bus: str) -> str:
    """The Unix socket of a daemon on this machine.

    Raises:
        UnreachableError: There is none; the message says why, or how to start one.
    """
    for folder in search_dirs():
        path = zenoh_socket(folder, bus)
        try:
            if path.is_socket():
                if not os.access(path, os.W_OK):
                    raise NotPermittedError(f"no right to use bus '{bus}': {JOIN}")
                return f"unixsock-stream/{path}"
        except PermissionError as error:
            from .unserved import has_shared_memory

            if has_shared_memory(bus):  # else none of these serves it
                raise NotPermittedError(f"no right to look into {folder}: {JOIN}") from error
    raise _unserved(bus)


def _is_coming(bus: str) -> bool:
    from .unserved import awaits_gateway

    return awaits_gateway(bus)


def _unserved(bus: str) -> EcatError:
    from .unserved import unserved

    return unserved(bus)


class Remote:
    """A session with the gateway of one bus.

    Args:
        bus: Name of the bus.
        connect: Zenoh endpoint such as `tls/host:7447`; by default the daemon of this machine.
        timeout: Seconds to wait for an answer.
        identity: File with the certificate of a user, for an encrypted endpoint; by default the one
            that `find_identity` finds.

    Raises:
        UnreachableError: No daemon is there.
        NotPermittedError: This user may not use it.
        UsageError: The file is no identity.
    """

    def __init__(
        self,
        bus: str = "ecat0",
        connect: str | None = None,
        timeout: float = 10.0,
        identity: Path | None = None,
    ) -> None:
        self.bus = check_bus_name(bus)
        self._timeout = timeout
        self._identity = find_identity(identity) if is_encrypted(connect) else None
        self._is_local = connect is None or connect.startswith("unixsock-stream/")
        self._connect = connect
        zenoh.init_log_from_env_or("off")
        self._session = self._opened()

    def _opened(self) -> zenoh.Session:
        connect, bus = self._connect, self.bus
        deadline = time.monotonic() + min(self._timeout, _GATEWAY_PATIENCE)
        while True:
            try:
                return self._open(connect or _local_endpoint(bus), connect is None)
            except UnreachableError:
                if connect or time.monotonic() > deadline or not _is_coming(bus):
                    raise
            time.sleep(_GATEWAY_PAUSE)

    def reconnect(self) -> None:
        """Begins another session, after a restart of the gateway; raises as the constructor."""
        before, self._session = self._session, self._opened()
        before.close()  # type: ignore[no-untyped-call]

    def _open(self, endpoint: str, found: bool) -> zenoh.Session:
        settings = {
            "connect/endpoints": [endpoint],
            "connect/timeout_ms": int(min(self._timeout, 2.0) * 1000),
            "connect/exit_on_failure": True,
            **(self._identity.settings if self._identity else {}),
        }
        try:
            config = session_config("client", settings)
        except zenoh.ZError as error:
            raise UsageError(f"'{endpoint}' is no Zenoh endpoint such as tcp/host:7447") from error
        try:
            return zenoh.open(config)
        except zenoh.ZError as error:
            if found:
                raise _unserved(self.bus) from error
            if is_encrypted(endpoint):
                raise UnreachableError(
                    f"no ecatd lets this user in for bus '{self.bus}' at {endpoint}: "
                    + whose(self._identity)
                ) from error
            raise UnreachableError(
                f"no ecatd answers for bus '{self.bus}' at {endpoint}; is it running, and does it "
                f"listen there?"
            ) from error

    def close(self) -> None:
        """Ends the session."""
        self._session.close()  # type: ignore[no-untyped-call]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def request(self, request: Request) -> dict[str, Any]:
        """Has the daemon carry a request out; its answer.

        Raises:
            EcatError: The error that the daemon replied, as its own class.
        """
        key, parameters, payload = to_query(request)
        if payload is not None:
            payload["id"] = _request_id()
            if self.user:
                key = (AS, self.user, *key)
        return self._ask(*key, payload=payload, parameters=parameters)

    def _ask(
        self, *key: str, payload: dict[str, Any] | None = None, parameters: str = ""
    ) -> dict[str, Any]:
        selector = bus_key(self.bus, *key) + (f"?{parameters}" if parameters else "")
        data = pack(payload) if payload is not None else None
        for reply in self._session.get(selector, payload=data, timeout=self._timeout):
            sample = reply.ok if reply.ok is not None else reply.err
            if sample is None:
                continue
            try:
                answer = unpack(bytes(sample.payload), MAX_REPLY)
            except UsageError:
                break  # an error reply of Zenoh itself: nobody answered
            if "error" in answer:
                raise EcatError.from_reply(answer["error"])
            return answer
        raise self._silence(key)

    def ask_all(self, what: str) -> dict[str, dict[str, Any]]:
        """Asks all buses in reach at once; the answers by the name of the bus.

        Args:
            what: The key below `ro`: `info` or `state`.
        """
        found = {}
        selector = bus_key("*", "ro", what)
        for reply in self._session.get(
            selector, target=zenoh.QueryTarget.ALL, timeout=self._timeout
        ):
            if reply.ok is not None:
                answer = unpack(bytes(reply.ok.payload), MAX_REPLY)
                found[str(reply.ok.key_expr).split("/")[2]] = answer
        return found

    def _silence(self, key: tuple[str, ...]) -> EcatError:
        """Why no answer came: a change that is asked for from the network gets none at all."""
        alive = any(
            reply.ok is not None
            for reply in self._session.liveliness().get(
                bus_key(self.bus, "alive"), timeout=min(self._timeout, 2.0)
            )
        )
        if not alive and self.user:
            return NotPermittedError(
                f"no daemon there lets user '{self.user}' use bus '{self.bus}': its configuration "
                "does not name this user in [[gateway.user]], it serves another bus, or its "
                "gateway is just starting"
            )
        if not alive and self._is_local:
            return _unserved(self.bus)
        if not alive:
            text = f"no ecatd serves bus '{self.bus}' there; {how_to_start(self.bus)}"
            return UnreachableError(text)
        silent = f"the daemon of bus '{self.bus}' gave no answer"
        if key[0] == AS:
            return NotPermittedError(
                f"{silent} to user '{self.user}': it does not know this user (`[[gateway.user]]` "
                "of its configuration), or is busy"
            )
        if key[0] == "rw" and not self._is_local:
            return NotPermittedError(
                f"{silent}: changes are permitted on its own machine to members of the group "
                f"'ecat', and to users with a certificate (`ecatctl remote`)"
            )
        silent += f" within {self._timeout:g} s: its bus server is busy, or hangs"
        if key[0] == "rw":
            silent += "; the change may still be carried out, so look before you ask again"
        return NoAnswerError(silent)

    @property
    def user(self) -> str:
        """The user as whom this session asks; empty if the connection does not know users."""
        return self._identity.user if self._identity else ""

    def rights(self) -> dict[str, Any]:
        """What the user of this session may do: `user`, `read`, `write`, `slaves` (empty: all).

        Raises:
            NotPermittedError: The connection does not know users, or not this one.
        """
        if not self.user:
            raise NotPermittedError("this connection does not know users: it has no certificate")
        return self._ask(AS, self.user, *RIGHTS)

    def info(self) -> dict[str, Any]:
        """Version, interface, start time and cycle time of the daemon."""
        return self.request(ReadInfo())

    def events(self, since: int = 0) -> dict[str, Any]:
        """The last events, from a number on.

        Returns:
            `events`, each with its `sequence`; `next`, the number of the next one; and `left_out`,
            how many from `since` on the daemon no longer keeps.
        """
        return self.request(ReadEvents(since))

    def read_frames(self, ring: str, position: int = 0) -> dict[str, Any]:
        """The last frames that were sent and received; see `bus/requests/frames.py`.

        Raises:
            StateError: The daemon keeps none.
        """
        return self.request(ReadFrames(ring, position))

    def describe(self) -> Bus:
        """The bus description."""
        from ecatd.model.bus_reader import read_bus

        return read_bus(self._ask("ro", "slaves"), "the answer of the daemon", strict=False)

    def configuration(self) -> tuple[Config, dict[str, str]]:
        """The configuration in force, and where values come from, by key.

        Keys are named as by `ecatd.model.config.origins.flatten`; those that are not in the map
        have their defaults.
        """
        from ecatd.model.config import read_config

        answer = self._ask("ro", "config")
        return read_config(answer["config"], "the answer of the daemon"), dict(answer["origins"])

    def states(self) -> list[dict[str, Any]]:
        """AL states of all slaves: `position`, names, `al_state`, `al_code` and `text`."""
        return list(self.request(ReadStates())["slaves"])

    def rescan(self) -> dict[str, Any]:
        """The devices that are on the wire now, and the slaves that are not; see `Wire.scan`.

        Raises:
            StateError: Devices come and go meanwhile.
        """
        return self.request(Rescan())

    def stream(self, pattern: str, rate: float) -> Stream:
        """Values of entries with minimum, mean and maximum, so that no peak is lost.

        Args:
            pattern: SLAVE/ENTRY with * and ?; see `find_signals`.
            rate: How often a second.

        Raises:
            UsageError: The rate is out of range, or there are too many entries.
            StateError: No entry fits the pattern.
        """
        from urllib.parse import quote

        from .stream import Stream

        parameters = f"pattern={quote(pattern, safe='')};hz={rate:g}"
        opened = self._ask("ro", "stream", parameters=parameters)
        return Stream(self._session, opened, self._timeout)

    def stats(self) -> Snapshot:
        """Statistics of the bus since the start of the exchange."""
        from ecatd.stats import from_map

        return from_map(self._ask("ro", "stats", parameters="buckets=1"))

    def clocks(self) -> dict[str, Any]:
        """The distributed clocks of the bus; see `ecatd.stats.clocks.read_clocks`."""
        return self._ask("ro", "dc")

    def sdo_read(
        self, slave: int | str, index: int, subindex: int = 0, *, complete: bool = False
    ) -> SdoValue:
        """Uploads an object of a slave, which is given by its position or name."""
        return _sdo_value(self.request(SdoRead(slave, index, subindex, complete)))

    def sdo_write(
        self,
        slave: int | str,
        index: int,
        subindex: int,
        data: bytes | str,
        *,
        complete: bool = False,
    ) -> SdoValue:
        """Downloads an object; returns what was downloaded.

        Args:
            slave: Position or name.
            index: Object index.
            subindex: Object subindex.
            data: Bytes, little endian; or the value as a person types it, for which the daemon
                finds the type out.
            complete: Complete access.
        """
        value, raw = (data, None) if isinstance(data, str) else (None, data)
        request = SdoWrite(slave, index, raw, subindex, complete, value, who())
        return _sdo_value(self.request(request))

    def list_objects(self, slave: int | str) -> list[int]:
        """The indices of all objects of a slave, which is given by its position or name.

        Raises:
            NoAnswerError: The slave does not describe its objects.
            StateError: As above; or it has no object dictionary.
        """
        return list(self.request(ListObjects(slave))["objects"])

    def describe_object(self, slave: int | str, index: int) -> DictionaryObject:
        """What an object of a slave is, with its entries.

        Raises:
            SdoAbortError: There is no such object.
            NoAnswerError: The slave does not describe its objects.
            StateError: As above; or it has no object dictionary.
        """
        from ecatd.model.dictionary import DictionaryObject

        return DictionaryObject.from_map(self.request(DescribeObject(slave, index)))

    def register_read(self, slave: int | str, address: int, size: int = 2) -> bytes:
        """Reads registers of the ESC of a slave, which is given by its position or name.

        Raises:
            UsageError: These are no registers (from 0x1000 on), or more than 256 bytes.
            StateError: There is no such slave, or it does not answer.
        """
        return bytes(self.request(ReadRegister(slave, address, size))["data"])

    def register_write(self, slave: int | str, address: int, data: bytes) -> bytes:
        """Writes registers; returns what they have afterwards. Raises as `register_read`."""
        return bytes(self.request(WriteRegister(slave, address, data, who()))["data"])

    def read_idn(self, slave: int | str, idn: int, drive: int = 0) -> IdnValue:
        """Reads an IDN of a drive (SoE), given as `ecatd.model.idns.parse_idn` makes it.

        Raises:
            StateError: There is no such slave or IDN, or the slave has no SoE.
        """
        from ecatd.model.idns import IdnValue

        return IdnValue.from_map(self.request(ReadIdn(slave, idn, drive)))

    def write_idn(self, slave: int | str, idn: int, data: bytes, drive: int = 0) -> IdnValue:
        """Writes the value of an IDN; returns what was written. Raises as `read_idn`."""
        from ecatd.model.idns import IdnValue

        return IdnValue.from_map(self.request(WriteIdn(slave, idn, data, drive, who())))

    def sii(self, slave: int | str) -> bytes:
        """Reads the whole EEPROM of a slave, which is given by its position or name.

        Raises:
            StateError: There is no such slave, or its EEPROM cannot be read.
        """
        from ecatd.model.sii_reader import whole_image

        parts: dict[int, bytes] = {}  # by number, `_SII_PART` words each

        def words(word: int, count: int) -> bytes:
            first, last = word // _SII_PART, (word + count - 1) // _SII_PART
            for number in range(first, last + 1):
                if number not in parts:
                    parts[number] = self.read_sii(slave, number * _SII_PART, _SII_PART)
            data = b"".join(parts[number] for number in range(first, last + 1))
            start = 2 * (word - first * _SII_PART)
            return data[start : start + 2 * count]

        return whole_image(words)

    def read_sii(self, slave: int | str, word: int, count: int) -> bytes:
        """Reads up to 256 words of the EEPROM of a slave, from one on; raises as `sii`."""
        return bytes(self.request(ReadSii(slave, word, count))["data"])

    def write_sii(self, slave: int | str, word: int, data: bytes) -> int:
        """Writes up to 64 words of the EEPROM of a slave; returns how many had other values.

        The slave uses them when it is switched on the next time.

        Args:
            slave: Position or name.
            word: Address of the first word.
            data: The words, little endian.

        Raises:
            StateError: There is no such slave, or its EEPROM cannot be written.
        """
        return int(self.request(WriteSii(slave, word, data, who()))["written"])

    def start_file_read(
        self, slave: int | str, file: str, *, password: int = 0, boot: bool = False
    ) -> FileTransfer:
        """Starts to read a file of a slave (FoE).

        Args:
            slave: Position or name.
            file: Its name, as the slave knows it.
            password: Its password, 0 for none.
            boot: Whether to bring the slave to BOOT for it, and back.

        Raises:
            BusyError: The slave has another transfer, or there are too many.
            StateError: There is no such slave.
        """
        from .file_transfer import FileTransfer

        request = StartFoe(slave, file, password=password, boot=boot, by=who())
        return FileTransfer(self, self.request(request))

    def start_file_write(
        self, slave: int | str, file: str, data: bytes, *, password: int = 0, boot: bool = False
    ) -> FileTransfer:
        """Starts to write a file to a slave (FoE); arguments and errors as `start_file_read`.

        `FileTransfer.send` then sends the data to the daemon. If the daemon is writing the same
        file already, this is that transfer.
        """
        import hashlib

        from .file_transfer import FileTransfer

        digest = hashlib.sha256(data).hexdigest()
        request = StartFoe(slave, file, True, len(data), digest, password, boot, who())
        return FileTransfer(self, self.request(request), data)

    def errors(self) -> list[SlaveErrors]:
        """The error counters of all slaves that answer."""
        return _slave_errors(self.request(ReadErrors()))

    def reset_errors(self, slave: int | str | None = None) -> list[SlaveErrors]:
        """Clears the error counters of one slave, or of all; returns as `errors`.

        Raises:
            StateError: There is no such slave, or it does not answer.
        """
        return _slave_errors(self.request(ResetErrors(slave, who())))

    def set_state(self, state: str, slave: int | str | None = None) -> list[dict[str, Any]]:
        """Brings one slave, or all, to an AL state; returns all states as `states` does."""
        return list(self.request(SetState(state, slave, who()))["slaves"])

    def log_levels(self) -> dict[str, dict[str, str]]:
        """By part, the `levels` of the log in force, and those that are `configured`."""
        return _levels(self.request(ReadLogLevels()))

    def set_log_level(self, level: str, part: str | None = None) -> dict[str, dict[str, str]]:
        """Changes the level of one part of the log, or of all; returns as `log_levels`.

        It lasts until the daemon reads its configuration again.
        """
        return _levels(self.request(SetLogLevel(level, part, who())))


def _levels(answer: dict[str, Any]) -> dict[str, dict[str, str]]:
    return {name: dict(answer[name]) for name in ("levels", "configured")}


def _slave_errors(answer: dict[str, Any]) -> list[SlaveErrors]:
    from ecatd.model.port_errors import SlaveErrors

    return [SlaveErrors.from_map(item) for item in answer["slaves"]]


def who() -> str:
    """This process, for the log of the daemon."""
    program = Path("/proc/self/comm").read_text(errors="replace").strip()
    name = "".join(letter if letter.isprintable() else "?" for letter in program)
    return f"{name} (pid {os.getpid()}, uid {os.getuid()})"


def _sdo_value(answer: dict[str, Any]) -> SdoValue:
    return SdoValue(**{key: answer[key] for key in SdoValue._fields if key in answer})


def _request_id() -> str:
    """Names one request, so that the daemon carries it out once even if it arrives twice."""
    return os.urandom(16).hex()
