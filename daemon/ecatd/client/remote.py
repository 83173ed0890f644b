"""Requests to a daemon over Zenoh: what `ecatctl` and programs on other hosts use."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from ecatd.base.errors import EcatError, NotPermittedError

from .arguments import octets, real
from .session import HOW_TO_CHANGE, Session

# What only some requests need is loaded by them: most commands are one request, and short.
if TYPE_CHECKING:
    from ecatd.config import Config
    from ecatd.description.bus import Bus, Slave
    from ecatd.description.cables import LinkVerdict
    from ecatd.etg.dictionary import DictionaryObject
    from ecatd.etg.idns import IdnValue
    from ecatd.etg.port_errors import SlaveErrors
    from ecatd.operations.bus import Rights
    from ecatd.operations.health import Health
    from ecatd.operations.objects import Sdo
    from ecatd.operations.registers import Errors
    from ecatd.shm.statistics import Snapshot

    from .file_transfer import FileTransfer
    from .stream import Stream
    from .trace import Trace

A = TypeVar("A")

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


class Remote(Session):
    """The daemon of one bus, over Zenoh.

    Args:
        bus: Name of the bus; HOST/BUS behind a router, and where the daemon has a `gateway.host`.
        connect: Zenoh endpoint such as `tls/host:7447`; by default the daemon of this machine.
        timeout: Seconds to wait for an answer.
        identity: File with the certificate of a user, or what was read from one, for an encrypted
            endpoint; by default the one that `find_identity` finds.

    Raises:
        UnreachableError: No daemon is there.
        NotPermittedError: This user may not use it.
        UsageError: The file is no identity.
    """

    def rights(self) -> Rights:
        """What the user of this session may do.

        Raises:
            NotPermittedError: The connection does not know users, or not this one.
        """
        if not self.user:
            raise NotPermittedError("this connection does not know users: it has no certificate")
        from ecatd.operations.bus import ReadRights

        return self.request(ReadRights(self.user))

    def why_not(self, right: str, slave: Slave) -> str:
        """Why the user of this session may not use a right for a slave; empty if this is allowed.

        Args:
            right: As `gateway.user.write` names it.
            slave: The slave.
        """
        if self.is_local:
            return ""
        if not self.user:
            return f"this connection only reads: {HOW_TO_CHANGE}"
        found = self.rights()
        if right not in found["write"]:
            return (
                f"user '{self.user}' has no right '{right}' (gateway.user.write in the "
                "configuration of the daemon)"
            )
        names = {slave.position, slave.given_name, slave.name} - {""}
        if found["slaves"] and names.isdisjoint(found["slaves"]):
            return (
                f"user '{self.user}' may change only slaves {', '.join(map(str, found['slaves']))} "
                "(gateway.user.slaves in the configuration of the daemon)"
            )
        return ""

    def describe(self) -> Bus:
        """The bus description."""
        from ecatd.description.bus_reader import read_bus
        from ecatd.operations.description import Describe

        return read_bus(self.request(Describe()), "the answer of the daemon", strict=False)

    def configuration(self) -> tuple[Config, dict[str, str]]:
        """The configuration in force, and where values come from, by key.

        Keys are named as by `ecatd.config.origins.flatten`; those that are not in the map
        have their defaults.
        """
        from ecatd.config import read_config
        from ecatd.operations.bus import ReadConfig

        answer = self.request(ReadConfig())
        return read_config(answer["config"], "the answer of the daemon"), dict(answer["origins"])

    def health(self) -> Health:
        """How the slaves are, with those that were missing at the start, and with other devices."""
        from ecatd.operations.bus import ReadStates
        from ecatd.operations.health import look_at

        return look_at(self.request(ReadStates()))

    def stream(self, pattern: str, rate: float) -> Stream:
        """Values of entries with minimum, mean and maximum, so that no peak is lost.

        Args:
            pattern: SLAVE/ENTRY with * and ?; see `find_signals`.
            rate: How often a second.

        Raises:
            UsageError: The rate is out of range, or there are too many entries.
            StateError: No entry fits the pattern.
        """
        from ecatd.operations.streams import OpenStream

        from .stream import Stream

        opened = self.request(OpenStream(pattern, real("rate", rate)))
        return Stream(self.zenoh, opened, self.timeout)

    def trace(self, patterns: Sequence[str], before_s: float = 0.0) -> Trace:
        """The values of entries in every cycle, as the frames have carried them.

        Args:
            patterns: SLAVE/ENTRY with * and ?; see `find_signals`.
            before_s: Seconds before now with which it begins, as far as the daemon keeps them.

        Raises:
            UsageError: There are too many entries.
            StateError: No entry fits a pattern, or the daemon keeps no frames.
        """
        from ecatd.operations.traces import History, OpenTrace, ReadHistory

        from .trace import Trace

        lines = "\n".join(patterns)

        def ask(begin: int, end: int) -> History:
            return self.request(ReadHistory(lines, begin, end))

        return Trace(self.zenoh, self.request(OpenTrace(lines)), self.timeout, before_s, ask)

    def stats(self) -> Snapshot:
        """Statistics of the bus since the start of the exchange."""
        from ecatd.operations.statistics import ReadStats
        from ecatd.shm.statistics import from_map

        return from_map(self.request(ReadStats(buckets=True)))

    def sdo_read(
        self, slave: int | str, index: int, subindex: int = 0, *, complete: bool = False
    ) -> SdoValue:
        """Uploads an object of a slave, which is given by its position or name."""
        from ecatd.operations.objects import SdoRead

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
        from ecatd.operations.objects import SdoWrite

        value, raw = (data, None) if isinstance(data, str) else (None, octets("data", data))
        return _sdo_value(self.request(SdoWrite(slave, index, raw, subindex, complete, value)))

    def describe_object(self, slave: int | str, index: int) -> DictionaryObject:
        """What an object of a slave is, with its entries.

        Raises:
            SdoAbortError: There is no such object.
            NoAnswerError: The slave does not describe its objects.
            StateError: As above; or it has no object dictionary.
        """
        from ecatd.etg.dictionary import DictionaryObject
        from ecatd.operations.objects import DescribeObject

        return DictionaryObject.from_map(self.request(DescribeObject(slave, index)))

    def describe_objects(
        self, slave: int | str, indices: Iterable[int]
    ) -> Iterator[DictionaryObject | EcatError]:
        """What many objects of a slave are, in order; or why one is not described.

        Args:
            slave: Position or name.
            indices: Of the objects, taken from there when they are asked for.
        """
        from ecatd.etg.dictionary import DictionaryObject
        from ecatd.operations.objects import DescribeObject

        for answer in self.request_all(DescribeObject(slave, index) for index in indices):
            if isinstance(answer, EcatError):
                yield answer
            else:
                yield DictionaryObject.from_map(answer)

    def read_idn(self, slave: int | str, idn: int, drive: int = 0) -> IdnValue:
        """Reads an IDN of a drive (SoE), given as `ecatd.etg.idns.parse_idn` makes it.

        Raises:
            StateError: There is no such slave or IDN, or the slave has no SoE.
        """
        from ecatd.etg.idns import IdnValue
        from ecatd.operations.idns import ReadIdn

        return IdnValue.from_map(self.request(ReadIdn(slave, idn, drive)))

    def write_idn(self, slave: int | str, idn: int, data: bytes, drive: int = 0) -> IdnValue:
        """Writes the value of an IDN; returns what was written. Raises as `read_idn`."""
        from ecatd.etg.idns import IdnValue
        from ecatd.operations.idns import WriteIdn

        request = WriteIdn(slave, idn, octets("data", data), drive)
        return IdnValue.from_map(self.request(request))

    def sii(self, slave: int | str, note: Callable[[int], None] = lambda _read: None) -> bytes:
        """Reads the whole EEPROM of a slave.

        Args:
            slave: Position or name.
            note: Called while it is being read; gets the number of bytes so far.

        Raises:
            StateError: There is no such slave, or its EEPROM cannot be read.
        """
        from ecatd.etg.sii_categories import whole_image
        from ecatd.operations.eeproms import ReadSii

        parts: dict[int, bytes] = {}  # by number, `_SII_PART` words each

        def words(word: int, count: int) -> bytes:
            first, last = word // _SII_PART, (word + count - 1) // _SII_PART
            for number in range(first, last + 1):
                if number not in parts:
                    request = ReadSii(slave, number * _SII_PART, _SII_PART)
                    parts[number] = self.request(request)["data"]
                    note(2 * _SII_PART * len(parts))
            data = b"".join(parts[number] for number in range(first, last + 1))
            start = 2 * (word - first * _SII_PART)
            return data[start : start + 2 * count]

        return whole_image(words)

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
        from ecatd.operations.files import StartFoe

        from .file_transfer import FileTransfer

        request = StartFoe(slave, file, password=password, boot=boot, only_find=only_find)
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

        from ecatd.operations.files import StartFoe

        from .file_transfer import FileTransfer

        data = octets("data", data)
        digest = hashlib.sha256(data).hexdigest()
        request = StartFoe(
            slave, file, True, len(data), digest, password, boot, only_find=only_find
        )
        return FileTransfer(self, self.request(request), data)

    def errors(self) -> list[SlaveErrors]:
        """The error counters of all slaves that answer."""
        return self.cables()[0]

    def cables(self) -> tuple[list[SlaveErrors], list[LinkVerdict]]:
        """As `errors`, and the verdict on each link of the bus."""
        from ecatd.description.cables import LinkVerdict
        from ecatd.operations.registers import ReadErrors

        answer = self.request(ReadErrors())
        maps: list[Any] = list(answer["links"])
        return _slave_errors(answer), [LinkVerdict(**item) for item in maps]

    def reset_errors(self, slave: int | str | None = None) -> list[SlaveErrors]:
        """Clears the error counters of one slave, or of all; returns as `errors`.

        Raises:
            StateError: There is no such slave, or it does not answer.
        """
        from ecatd.operations.registers import ResetErrors

        return _slave_errors(self.request(ResetErrors(slave)))

    def log_lines(self) -> Iterator[dict[str, Any]]:
        """Yields new lines of the log as they come; see LogLine in docs/zenoh-keys.md.

        Raises:
            NoAnswerError: The daemon has ended, or the connection is broken.
        """
        from .stream import log_lines

        return log_lines(self.zenoh, self.full_name)


def _slave_errors(answer: Errors) -> list[SlaveErrors]:
    from ecatd.etg.port_errors import SlaveErrors

    return [SlaveErrors.from_map(item) for item in answer["slaves"]]


def _sdo_value(answer: Sdo) -> SdoValue:
    return SdoValue(**{key: value for key, value in answer.items() if key in SdoValue._fields})  # type: ignore[arg-type]
