"""What is published under which Zenoh key, and when."""

from __future__ import annotations

from ecatd.operations.bus import Event
from ecatd.operations.description import BusDescription
from ecatd.operations.log import LogLine
from ecatd.operations.statistics import Statistics
from ecatd.operations.streams import PdoValue, StreamRow

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
