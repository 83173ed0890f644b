"""The last frames, and what writes incidents: `[flight_recorder]`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from ecatd.base.toml_file import Key, Table, accepts, integer, number, show

from .placed import Placed, each, read


@accepts("a whole path")
def _folder(table: Table, key: Key) -> str:
    path = table.text(key)
    if path and not (path.startswith("/") and path.isprintable()):
        table.fail(key, f'{show(path)} is no folder: write its whole path, "/var/lib/ecatd"')
    return path


@accepts("a text")
def _signal(table: Table, key: Key) -> str:
    name = table.text(key)
    if not name or not name.isprintable():
        table.fail(key, f'{show(name)} is no entry: write SLAVE/ENTRY, such as "4/0x6000:01"')
    return name


@dataclass(slots=True)
class ConditionConfig(Placed):
    """`[[flight_recorder.condition]]`: values of an entry that begin an incident.

    The recorder looks at the value of every cycle, as the frames had it. An incident begins when
    the condition becomes true after it was false.

    Attributes:
        signal: The entry: SLAVE/ENTRY, by names or addresses.
        above: True if the physical value is larger than this. Default: not looked at.
        below: True if the physical value is smaller than this. With `above` too: true if either
            holds. Default: not looked at.
        pause_s: Shortest time between two incidents of this condition.
    """

    signal: Annotated[str, _signal]
    above: Annotated[float | None, number()] = None
    below: Annotated[float | None, number()] = None
    pause_s: Annotated[float, number(0, 86400)] = 60.0


@dataclass(slots=True)
class FlightRecorderConfig(Placed):
    """`[flight_recorder]`: the [last frames](command-line.md#frames), [incidents](incidents.md).

    Attributes:
        memory_mb: Memory of the bus server for the last frames: half for the frames of the cycle,
            half for all others. 0: keep none; then `ecatctl record` has no values, and there are
            no incidents. The log says at the start how many seconds fit.
        folder: Where the recorder writes incidents, such as `"/var/lib/ecatd/ecat0"`, which the
            service can write. The start makes the folder, and members of the group `ecat` can read
            it. `""`: there is no recorder.
        before_s: Seconds before the trigger that an incident has; fewer if `memory_mb` holds fewer.
        after_s: Seconds behind the trigger.
        disk_mb: Most room for all incidents of this bus in `folder`; the oldest ones go first.
        per_hour: Most incidents in an hour that nobody has asked for.
        faults: A fault begins an incident: slaves are lost or leave OP, links are lost, working
            counters are wrong, errors rise, a slave sends an emergency.
        lapses: A client that ends without releasing its outputs, or hangs, begins an incident.
        condition: Values that begin an incident.
    """

    memory_mb: Annotated[int, integer(0, 1024)] = 16
    folder: Annotated[str, _folder] = ""
    before_s: Annotated[float, number(0.1, 600)] = 5.0
    after_s: Annotated[float, number(0, 60)] = 1.0
    disk_mb: Annotated[int, integer(1, 1_000_000)] = 500
    per_hour: Annotated[int, integer(1, 1000)] = 12
    faults: Annotated[bool, Table.boolean] = True
    lapses: Annotated[bool, Table.boolean] = True
    condition: Annotated[list[ConditionConfig], each(ConditionConfig)] = field(default_factory=list)


def read_flight_recorder(top: Table, key: Key) -> FlightRecorderConfig:
    """Reads `[flight_recorder]`."""
    table = top.table(key)
    config = read(FlightRecorderConfig, table)
    if config.folder and not config.memory_mb:
        table.fail("memory_mb", "is 0, so no frames are kept of which incidents could be made")
    for condition in config.condition:
        if condition.above is None and condition.below is None:
            condition.table.fail(None, "needs 'above' or 'below'")
    return config
