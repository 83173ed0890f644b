"""Which map comes under which key: answers to queries, and publications."""

from __future__ import annotations

from ecatd.operations.bus import (
    Describe,
    ReadConfig,
    ReadEvents,
    ReadInfo,
    ReadStates,
    Rescan,
    SetState,
)
from ecatd.operations.eeproms import ReadSii, WriteSii
from ecatd.operations.ethernet import ReadEthernet, ReadIp, WriteIp
from ecatd.operations.files import CancelFoe, PutFoe, ReadFoe, StartFoe, TakeFoe
from ecatd.operations.frames import ReadFrames
from ecatd.operations.idns import ReadIdn, WriteIdn
from ecatd.operations.log import ReadLogLevels, SetLogLevel
from ecatd.operations.objects import DescribeObject, ListObjects, SdoRead, SdoWrite
from ecatd.operations.operation import Request
from ecatd.operations.queries import needs_right
from ecatd.operations.registers import ReadErrors, ReadRegister, ResetErrors, WriteRegister

from .bus_maps import (
    BusDescription,
    Configuration,
    Event,
    Events,
    Frames,
    Info,
    LogLevels,
    Rights,
    States,
    Wire,
)
from .published_maps import LogLine, PdoValue, Stream, StreamRow
from .slave_maps import (
    Data,
    Errors,
    Ethernet,
    Idn,
    Ip,
    ObjectDescription,
    Objects,
    Sdo,
    Transfer,
    Written,
)
from .statistics_maps import Clocks, Statistics


class ReadStats(Request):
    """Asks for the statistics.

    Attributes:
        buckets: Whether to have whole histograms.
    """

    op = "stats"
    key = "ro/stats"
    buckets: bool = False


class ReadClocks(Request):
    """Asks about the distributed clocks."""

    op = "dc"
    key = "ro/dc"


class OpenStream(Request):
    """Opens a stream of entries; it ends 5 s after the last reader has left.

    Readers with the same pattern and rate share a stream.

    Attributes:
        pattern: SLAVE/ENTRY with `*` and `?`, percent-encoded: `4%2F*`.
        hz: Rows a second.
    """

    op = "stream"
    key = "ro/stream"
    pattern: str = "*"
    hz: float = 10.0


class ReadRights(Request):
    """Asks what a user of another machine may do.

    Attributes:
        user: Name of the user.
    """

    op = "rights"
    key = "as/{user}/ro/rights"
    user: str


ANSWERS: dict[type[Request], type] = {
    ReadInfo: Info,
    Describe: BusDescription,
    ReadConfig: Configuration,
    ReadStates: States,
    Rescan: Wire,
    ReadStats: Statistics,
    ReadClocks: Clocks,
    ReadLogLevels: LogLevels,
    ReadEvents: Events,
    ReadFrames: Frames,
    OpenStream: Stream,
    SdoRead: Sdo,
    ListObjects: Objects,
    DescribeObject: ObjectDescription,
    ReadRegister: Data,
    ReadErrors: Errors,
    ReadSii: Data,
    ReadEthernet: Ethernet,
    ReadIp: Ip,
    ReadIdn: Idn,
    ReadFoe: Transfer,
    TakeFoe: Data,
    SetState: States,
    SdoWrite: Sdo,
    WriteRegister: Data,
    ResetErrors: Errors,
    WriteSii: Written,
    WriteIp: Ip,
    WriteIdn: Idn,
    StartFoe: Transfer,
    PutFoe: Transfer,
    CancelFoe: Transfer,
    SetLogLevel: LogLevels,
    ReadRights: Rights,
}
"""The answers to all requests."""

READS = [kind for kind in ANSWERS if not needs_right(kind)]
CHANGES = [kind for kind in ANSWERS if needs_right(kind)]

PUBLICATIONS: dict[str, tuple[type, str]] = {
    "ro/event": (Event, "each event at once"),
    "ro/log/lines": (LogLine, "each line of the log of the bus server from level notice up"),
    "ro/pdo/{slave}/{address}": (
        PdoValue,
        "a value when it has changed, at most `gateway.publish_hz` times a second, and in any case "
        "every second; `address` is `0xINDEX:SUB`, both in hexadecimal",
    ),
    "ro/slaves": (BusDescription, "after a reload that has changed it"),
    "ro/stats": (Statistics, "every second while somebody subscribes, without `buckets`"),
    "ro/stream/{id}": (StreamRow, "a row of a stream"),
}
"""What is published under which key, and when."""
