"""Requests to a daemon over Zenoh: what `ecatctl` and programs on other hosts use."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from ecatd.base.errors import NotPermittedError
from ecatd.operations.bus import ReadEvents, ReadInfo, ReadStates, Rescan, SetState
from ecatd.operations.eeproms import ReadSii, WriteSii
from ecatd.operations.ethernet import ReadEthernet, ReadIp, WriteIp
from ecatd.operations.files import StartFoe
from ecatd.operations.frames import ReadFrames
from ecatd.operations.idns import ReadIdn, WriteIdn
from ecatd.operations.log import ReadLogLevels, SetLogLevel
from ecatd.operations.objects import DescribeObject, ListObjects, SdoRead, SdoWrite
from ecatd.operations.operation import Request
from ecatd.operations.registers import ReadErrors, ReadRegister, ResetErrors, WriteRegister
from ecatd.operations.zenoh_keys import AS, RIGHTS

from .arguments import octets, real, text
from .identity import who
from .session import Session

# What only some requests need is loaded by them: most commands are one request, and short.
if TYPE_CHECKING:
    from ecatd.config import Config
    from ecatd.description.bus import Bus
    from ecatd.etg.dictionary import DictionaryObject
    from ecatd.etg.idns import IdnValue
    from ecatd.etg.port_errors import SlaveErrors
    from ecatd.operations.health import Health
    from ecatd.shm.statistics import Snapshot

    from .file_transfer import FileTransfer
    from .stream import Stream

_SII_PART = 64
"""Words of an EEPROM that one request reads: the size of the smallest one. Other requests wait
meanwhile, for some milliseconds."""


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


class Remote:
    """The daemon of one bus, over Zenoh.

    Args:
        bus: Name of the bus; HOST/BUS behind a router, and where the daemon has a `gateway.host`.
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
        self._session = Session(bus, connect, timeout, identity)
        self.bus = self._session.bus

    def close(self) -> None:
        """Ends the session."""
        self._session.close()

    def reconnect(self) -> None:
        """Begins another session, after a restart of the gateway; raises as the constructor."""
        self._session.open()

    def request(self, request: Request) -> dict[str, Any]:
        """Has the daemon carry a request out; its answer.

        Raises:
            EcatError: The error that the daemon replied, as its own class.
        """
        return self._session.request(request)

    def alive(self) -> list[str]:
        """The names of the buses in reach, in order: BUS or HOST/BUS."""
        return self._session.alive()

    def ask_all(self, *what: str) -> list[dict[str, dict[str, Any]]]:
        """Asks all buses in reach at once; for each key the answers by the name of the bus.

        Args:
            what: Keys below `ro`: `info` or `state`.
        """
        return self._session.ask_all(*what)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    @property
    def user(self) -> str:
        """The user as whom this session asks; empty if the connection does not know users."""
        return self._session.user

    def rights(self) -> dict[str, Any]:
        """What the user of this session may do: `user`, `read`, `write`, `slaves` (empty: all).

        Raises:
            NotPermittedError: The connection does not know users, or not this one.
        """
        if not self.user:
            raise NotPermittedError("this connection does not know users: it has no certificate")
        return self._session.ask(AS, self.user, *RIGHTS)

    def info(self) -> dict[str, Any]:
        """Version, interface, start time and cycle time of the daemon."""
        return self.request(ReadInfo())

    def events(self, since: int = 0) -> dict[str, Any]:
        """The last events, from a number on.

        Returns:
            `instance`, which stands for this run of the daemon: another run counts from 1 again;
            `events`, each with its `sequence`; `next`, the number of the next one; and `left_out`,
            how many from `since` on the daemon no longer keeps.
        """
        return self.request(ReadEvents(since))

    def read_frames(self, ring: str, position: int = 0) -> dict[str, Any]:
        """The last frames that were sent and received; see `server/requests/frames.py`.

        Raises:
            StateError: The daemon keeps none.
        """
        return self.request(ReadFrames(ring, position))

    def describe(self) -> Bus:
        """The bus description."""
        from ecatd.description.bus_reader import read_bus

        return read_bus(self._session.ask("ro", "slaves"), "the answer of the daemon", strict=False)

    def configuration(self) -> tuple[Config, dict[str, str]]:
        """The configuration in force, and where values come from, by key.

        Keys are named as by `ecatd.config.origins.flatten`; those that are not in the map
        have their defaults.
        """
        from ecatd.config import read_config

        answer = self._session.ask("ro", "config")
        return read_config(answer["config"], "the answer of the daemon"), dict(answer["origins"])

    def states(self) -> list[dict[str, Any]]:
        """AL states of all slaves: `position`, names, `al_state`, `al_code` and `text`."""
        return list(self.request(ReadStates())["slaves"])

    def health(self) -> Health:
        """How the slaves are, with those that were missing at the start, and with other devices."""
        from ecatd.operations.health import look_at

        return look_at(self.states_reply())

    def states_reply(self) -> dict[str, Any]:
        """The answer behind `health` and `states`, as the bus server has given it."""
        return self.request(ReadStates())

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

        sought, hz = text("pattern", pattern), real("rate", rate)
        parameters = f"pattern={quote(sought, safe='')};hz={hz:g}"
        opened = self._session.ask("ro", "stream", parameters=parameters)
        return Stream(self._session.zenoh, opened, self._session.timeout)

    def stats(self) -> Snapshot:
        """Statistics of the bus since the start of the exchange."""
        from ecatd.shm.statistics import from_map

        return from_map(self._session.ask("ro", "stats", parameters="buckets=1"))

    def clocks(self) -> dict[str, Any]:
        """The distributed clocks of the bus; see `ecatd.shm.statistics.clocks.read_clocks`."""
        return self._session.ask("ro", "dc")

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
        value, raw = (data, None) if isinstance(data, str) else (None, octets("data", data))
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
        from ecatd.etg.dictionary import DictionaryObject

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
        return bytes(
            self.request(WriteRegister(slave, address, octets("data", data), who()))["data"]
        )

    def read_idn(self, slave: int | str, idn: int, drive: int = 0) -> IdnValue:
        """Reads an IDN of a drive (SoE), given as `ecatd.etg.idns.parse_idn` makes it.

        Raises:
            StateError: There is no such slave or IDN, or the slave has no SoE.
        """
        from ecatd.etg.idns import IdnValue

        return IdnValue.from_map(self.request(ReadIdn(slave, idn, drive)))

    def write_idn(self, slave: int | str, idn: int, data: bytes, drive: int = 0) -> IdnValue:
        """Writes the value of an IDN; returns what was written. Raises as `read_idn`."""
        from ecatd.etg.idns import IdnValue

        request = WriteIdn(slave, idn, octets("data", data), drive, who())
        return IdnValue.from_map(self.request(request))

    def ethernet(self) -> dict[str, Any]:
        """The interface to slaves with EoE, and the frames of each of them."""
        return self.request(ReadEthernet())

    def read_ip(self, slave: int | str) -> dict[str, Any]:
        """Reads the IP parameters of a slave: mac, address, mask, gateway, dns, name; None each.

        Raises:
            StateError: There is no such slave, it has no EoE, or it refuses the request.
        """
        return self.request(ReadIp(slave))

    def write_ip(
        self,
        slave: int | str,
        *,
        mac: str | None = None,
        address: str | None = None,
        gateway: str | None = None,
        dns: str | None = None,
        name: str | None = None,
    ) -> dict[str, Any]:
        """Writes the given IP parameters of a slave; the others stay. Raises as `read_ip`.

        Args:
            slave: Position or name.
            mac: MAC address, as `02:00:00:00:00:01`.
            address: IP address with the size of the network, as `192.168.7.2/24`.
            gateway: Default gateway, or "none".
            dns: DNS server, or "none".
            name: DNS name, or "none".

        Returns:
            What the slave has now, as `read_ip`, and what it had, as `before`.

        Raises:
            UsageError: A parameter is malformed.
        """
        return self.request(WriteIp(slave, mac, address, gateway, dns, name, who()))

    def sii(self, slave: int | str, note: Callable[[int], None] = lambda _read: None) -> bytes:
        """Reads the whole EEPROM of a slave.

        Args:
            slave: Position or name.
            note: Called while it is being read; gets the number of bytes so far.

        Raises:
            StateError: There is no such slave, or its EEPROM cannot be read.
        """
        from ecatd.etg.sii_categories import whole_image

        parts: dict[int, bytes] = {}  # by number, `_SII_PART` words each

        def words(word: int, count: int) -> bytes:
            first, last = word // _SII_PART, (word + count - 1) // _SII_PART
            for number in range(first, last + 1):
                if number not in parts:
                    parts[number] = self.read_sii(slave, number * _SII_PART, _SII_PART)
                    note(2 * _SII_PART * len(parts))
            data = b"".join(parts[number] for number in range(first, last + 1))
            start = 2 * (word - first * _SII_PART)
            return data[start : start + 2 * count]

        return whole_image(words)

    def read_sii(self, slave: int | str, word: int, count: int) -> bytes:
        """Reads up to 256 words of the EEPROM of a slave, from one on; raises as `sii`."""
        return bytes(self.request(ReadSii(slave, word, count))["data"])

    def write_sii(self, slave: int | str, word: int, data: bytes, *, more: bool = False) -> int:
        """Writes up to 64 words of the EEPROM of a slave; returns how many had other values.

        The slave uses them when it is switched on the next time.

        Args:
            slave: Position or name.
            word: Address of the first word.
            data: The words, little endian.
            more: Whether this process writes more parts. Until the last one, no other process may
                write this EEPROM.

        Raises:
            BusyError: Another process writes this EEPROM.
            StateError: There is no such slave, or its EEPROM cannot be written.
        """
        request = WriteSii(slave, word, octets("data", data), more, who())
        return int(self.request(request)["written"])

    def start_file_read(
        self,
        slave: int | str,
        file: str,
        *,
        password: int = 0,
        boot: bool = False,
        only_find: bool = False,
    ) -> FileTransfer:
        """Starts to read a file of a slave (FoE).

        If the daemon is transferring the same file already, this is that transfer.

        Args:
            slave: Position or name.
            file: Its name, as the slave knows it.
            password: Its password, 0 for none.
            boot: Whether to bring the slave to BOOT for it, and back.
            only_find: Whether to start nothing if there is no such transfer.

        Raises:
            BusyError: The slave has another transfer, or there are too many.
            StateError: There is no such slave; or no such transfer, with `only_find`.
        """
        from .file_transfer import FileTransfer

        request = StartFoe(slave, file, password=password, boot=boot, by=who(), only_find=only_find)
        return FileTransfer(self, self.request(request))

    def start_file_write(
        self,
        slave: int | str,
        file: str,
        data: bytes,
        *,
        password: int = 0,
        boot: bool = False,
        only_find: bool = False,
    ) -> FileTransfer:
        """Starts to write a file to a slave (FoE); arguments and errors as `start_file_read`.

        `FileTransfer.send` then sends the data to the daemon.
        """
        import hashlib

        from .file_transfer import FileTransfer

        data = octets("data", data)
        digest = hashlib.sha256(data).hexdigest()
        request = StartFoe(slave, file, True, len(data), digest, password, boot, who(), only_find)
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

    def log_lines(self) -> Iterator[dict[str, Any]]:
        """Yields new lines of the log as they come; see LogLine in docs/zenoh-keys.md.

        Raises:
            NoAnswerError: The daemon has ended, or the connection is broken.
        """
        from .log_lines import log_lines

        return log_lines(self._session.zenoh, self._session.full_name)

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
    from ecatd.etg.port_errors import SlaveErrors

    return [SlaveErrors.from_map(item) for item in answer["slaves"]]


def _sdo_value(answer: dict[str, Any]) -> SdoValue:
    return SdoValue(**{key: answer[key] for key in SdoValue._fields if key in answer})
