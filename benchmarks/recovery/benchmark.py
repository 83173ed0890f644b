"""Slaves that come back or join while the rest of the bus runs at 1 kHz, and start-up parameters.

The simulator causes the faults. It also reports the facts: which slaves are in OP, and which
parameters the drive has received.
"""

from __future__ import annotations

import contextlib
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

from ecatd import Client
from ecatsim.control import Simulator

from ..bench import Bench
from ..health import Health
from ..machine import Processors
from ..masters.daemon import Daemon
from ..segment.peers import ecatsim

SETTINGS = {
    "quick": {"losses": 1, "joins": 2, "slaves": 10, "pause": 0.1},
    "full": {"losses": 100},
}
_PATIENCE = 60.0
_LOOK = 0.005
"""Seconds between two queries of the simulator."""
_RIG = """
name = "machine"
[[slave]]
device = "EK1100"
[[slave]]
device = "EL2008"
[[slave]]
device = "ElmoGold"
[[slave]]
device = "EK1122"
[[slave]]
device = "EK1100"
at = { slave = 3, port = 3 }
[[slave]]
device = "EL2004"
[[slave]]
device = "EL1018"
[[slave]]
device = "EK1100"
at = { slave = 3, port = 1 }
[[slave]]
device = "CiA402"
parameters = { forgetful = true }
"""
_IDENTITIES = {"EK1100": (2, 0x044C2C52), "EL2004": (2, 0x07D43052), "EL1018": (2, 0x03FA3052)}
_GROUP = (4, 5, 6)
_OTHER_DRIVE, _DRIVE = 2, 8
_TORQUE = (0x6072, 700)  # object and value of the maximum torque, which the drive forgets
_DRIVE_CONFIGURATION = f"""
[[slave]]
position = {_DRIVE}
watchdog_ms = 500
[[slave.pdo]]
index = "0x1A00"
entries = [
  {{ object = "0x6041:00", bits = 16 }},
  {{ object = "0x6064:00", bits = 32 }},
  {{ object = "0x6061:00", bits = 8 }},
  {{ bits = 8 }},
]
[[slave.startup]]
object = "{_TORQUE[0]:#06x}:00"
type = "uint16"
value = {_TORQUE[1]}
[[slave.startup]]
object = "0x6065:00"
type = "uint32"
value = 1234
transition = "IP"
[[slave.startup]]
object = "0x6081:00"
type = "uint32"
value = 10000
transition = "SO"
"""
_SETTINGS = (0x11, 0x13, 0x14)
"""Subindices of the settings of a channel of an EL3008 (int16): offset and limits."""
_CHANNELS = 8


def measure(
    bench: Bench,
    *,
    losses: int = 20,
    joins: int = 100,
    slaves: int = 200,
    objects: int = 20,
    pause: float = 0.5,
) -> dict[str, Any]:
    """Runs the whole benchmark and returns its results.

    Args:
        bench: Folder and processors for the measurement.
        losses: How often a drive loses its power.
        joins: How often a hot connect group of three slaves joins and leaves.
        slaves: Number of slaves on the bus whose slaves have start-up parameters.
        objects: Number of start-up parameters of each of these slaves.
        pause: Seconds between two changes of the bus.
    """
    with bench.awake():
        return {
            "processors": bench.processors.to_json(),
            "power": _lose_power(bench, losses, pause),
            "group": _join(bench, joins, pause),
            "told": _start_up_parameters(bench, slaves, objects),
        }


class _Counts:
    """The counters of an engine, apart for the changes of the bus and for the pauses between them.

    The machine itself misses cycles and loses frames, so the two are compared.
    """

    def __init__(self, bus: str) -> None:
        self._bus = bus
        self._sums: dict[str, dict[str, int]] = {"changes": {}, "pauses": {}}

    def during(self, kind: str, work: Callable[[], Any]) -> Any:
        """Does some work, and returns its result; `kind` says to what its cycles belong."""
        before = Health(self._bus)
        result = work()
        for key, number in Health(self._bus).since(before).counts.items():
            self._sums[kind][key] = self._sums[kind].get(key, 0) + number
        return result

    def to_json(self) -> dict[str, Any]:
        """Returns the counters of both kinds, and how many more of 1000 there are at changes."""

        def excess(what: str, of: str) -> float:
            share = {key: 1000 * item[what] / item[of] for key, item in self._sums.items()}
            return share["changes"] - share["pauses"]

        return {
            **self._sums,
            "more_missed": excess("missed_cycles", "cycles"),
            "more_lost": excess("lost_frames", "frames"),
        }


def _lose_power(bench: Bench, losses: int, pause: float) -> dict[str, Any]:
    """Switches the last slave, a drive with configured PDOs and parameters, off and on again."""
    bench.say(f"a drive loses its power {losses} times")
    with _machine(bench, _DRIVE_CONFIGURATION) as (daemon, rig):
        seconds, fallen, verified = [], 0, 0
        counts = _Counts(daemon.bus)

        def lose() -> None:
            rig.faults.power_off(_DRIVE)
            time.sleep(pause)

        def come_back() -> tuple[float, int]:
            rig.faults.power_on(_DRIVE)
            return _wait_for_op(rig, range(_DRIVE + 1), {_DRIVE})

        for _ in range(losses):
            counts.during("changes", lose)
            took, down = counts.during("changes", come_back)
            seconds.append(took)
            fallen += down
            verified += rig.get(_DRIVE, _TORQUE[0]) == _TORQUE[1]
            counts.during("pauses", lambda: time.sleep(pause))
    found = {"losses": losses, "fallen": fallen, "verified": verified}
    return {**found, **_summary(seconds), **counts.to_json()}


def _join(bench: Bench, joins: int, pause: float) -> dict[str, Any]:
    """Makes a group join and leave, while a client reads an object of another drive."""
    bench.say(f"a group joins and leaves {joins} times")
    others = [n for n in range(_DRIVE + 1) if n not in _GROUP]
    seconds, fallen = [], 0

    def leave() -> None:
        rig.faults.break_link(_GROUP[0])
        for position in _GROUP:
            rig.faults.power_off(position)
        time.sleep(pause)

    def join() -> tuple[float, int]:
        for position in _GROUP:
            rig.faults.power_on(position)
        rig.faults.heal_link(_GROUP[0])
        return _wait_for_op(rig, range(_DRIVE + 1), set(_GROUP))

    with _machine(bench, _expected()) as (daemon, rig), _asking(daemon) as asked:
        counts = _Counts(daemon.bus)
        for _ in range(joins):
            counts.during("changes", leave)
            counts.during("pauses", lambda: time.sleep(pause))
            took, down = counts.during("changes", join)
            seconds.append(took)
            fallen += down
            counts.during("pauses", lambda: time.sleep(pause))
            fallen += _down(rig, others)
    found = {"joins": joins, "fallen": fallen, "asked": asked[0]}
    return {**found, **_summary(seconds), **counts.to_json()}


def _start_up_parameters(bench: Bench, slaves: int, objects: int) -> dict[str, Any]:
    """Measures the time from the command to OP, with and without start-up parameters.

    There are no cycles before OP, so no processor is kept for the engine.
    """
    bench = bench.on(Processors.together())
    bench.say(f"{slaves} slaves with {objects} start-up parameters each")
    rig = bench.folder / "terminals.toml"
    rig.write_text('name = "terminals"\n' + '[[slave]]\ndevice = "EL3008"\n' * slaves)
    addresses = [(0x8000 + 16 * n, sub) for sub in _SETTINGS for n in range(_CHANNELS)][:objects]
    parameters = "".join(
        f'[[slave.startup]]\nobject = "{index:#06x}:{sub:02X}"\ntype = "int16"\nvalue = 100\n'
        for index, sub in addresses
    )
    more = "".join(f"[[slave]]\nposition = {n}\n{parameters}" for n in range(slaves))
    found: dict[str, Any] = {"slaves": slaves, "objects": len(addresses)}
    for key, text in (("without", ""), ("with", more)):
        with ecatsim(rig, bench.processors), Daemon(bench, more=text) as daemon:
            found[key] = daemon.seconds
    return found


@contextlib.contextmanager
def _machine(bench: Bench, more: str) -> Iterator[tuple[Daemon, Simulator]]:
    rig = bench.folder / "machine.toml"
    rig.write_text(_RIG)
    description = bench.folder / "machine.json"
    command = (sys.executable, "-m", "ecatd.cli", "scan", "--from", rig, "-o", description)
    subprocess.run(command, check=True, capture_output=True)
    more = more.replace("DESCRIPTION", str(description))
    name = f"{bench.bus}-rig"
    with (
        ecatsim(rig, bench.processors, "--name", name),
        Daemon(bench, more=more) as daemon,
        Simulator(name) as simulator,
    ):
        yield daemon, simulator


def _expected() -> str:
    """Returns a configuration in which the slaves of the group are optional."""
    text = '[expected]\ndescription = "DESCRIPTION"\n'
    for position, kind in zip(_GROUP, _IDENTITIES, strict=True):
        vendor, product = _IDENTITIES[kind]
        text += f'[[slave]]\nposition = {position}\nname = "s{position}"\ngroup = "tool"\n'
        text += f"vendor = {vendor}\nproduct = {product}\n"
        text += "watchdog_ms = 500\n" if kind == "EL2004" else ""
    return text


@contextlib.contextmanager
def _asking(daemon: Daemon) -> Iterator[list[int]]:
    """Reads an object of the other drive without pause, in a thread.

    Yields:
        A list whose only element is the number of reads so far.
    """
    asked, done = [0], threading.Event()

    def ask() -> None:
        with Client(daemon.bus) as client:
            while not done.is_set():
                client.sdo_upload(_OTHER_DRIVE, 0x1018, 1).result()
                asked[0] += 1

    thread = threading.Thread(target=ask)
    thread.start()
    try:
        yield asked
    finally:
        done.set()
        thread.join()


def _down(rig: Simulator, positions: Any) -> int:
    slaves = rig.status().slaves
    return sum(slaves[n].state != "OP" for n in positions)


def _wait_for_op(rig: Simulator, all_of_them: range, coming: set[int]) -> tuple[float, int]:
    """Waits until the slaves `coming` are in OP.

    Returns:
        The seconds it took, and how often another slave was seen in a state other than OP.
    """
    begin, fallen = time.monotonic(), 0
    others = [n for n in all_of_them if n not in coming]
    while _down(rig, coming):
        fallen += _down(rig, others)
        assert time.monotonic() - begin < _PATIENCE, "a slave does not come back"
        time.sleep(_LOOK)
    return time.monotonic() - begin, fallen


def _summary(seconds: list[float]) -> dict[str, Any]:
    each = [{"number": n, "seconds": value} for n, value in enumerate(seconds, 1)]
    return {"median": statistics.median(seconds), "longest": max(seconds), "each": each}
