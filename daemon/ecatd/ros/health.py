"""The health of the bus as `/diagnostics` has it, from the shared memory."""

from __future__ import annotations

from collections.abc import Sequence

from ecatd.base.errors import EcatError
from ecatd.client.info import SlaveInfo
from ecatd.etg.al import AlState, al_state_text, al_status_text
from ecatd.shm.statistics import Snapshot, read
from ecatd.shm.statistics.problems import find_problems, word

from .joints import Joints
from .messages import Level, Status


def statuses(bus: str, slaves: Sequence[SlaveInfo], joints: Joints | None) -> list[Status]:
    """The status of the bus, of each slave, and of the joints.

    Args:
        bus: Name of the bus.
        slaves: The slaves; none while nobody can say.
        joints: The joints; None if there are none, or while nobody can say.
    """
    hardware = f"EtherCAT bus {bus}"
    found = [_of_bus(bus, hardware), *(_of_slave(bus, hardware, slave) for slave in slaves)]
    return found if joints is None else [*found, _of_joints(bus, hardware, joints)]


def _of_bus(bus: str, hardware: str) -> Status:
    name = f"ecatd: bus {bus}"
    try:
        snapshot = read(bus)
    except EcatError as error:
        return Status(Level.ERROR, name, str(error), hardware)
    problems = find_problems(snapshot)
    level = Level.ERROR if problems else Level.OK
    text = "; ".join(problems) or f"{snapshot.slaves_found} slaves in OP"
    return Status(level, name, text, hardware, _facts(snapshot))


def _facts(snapshot: Snapshot) -> dict[str, str]:
    facts = {
        "daemon": f"ecatd {snapshot.version}, {word(snapshot.state)}",
        "cycle": f"{snapshot.cycle_time_ns / 1000:g} µs",
        "cycles": str(snapshot.cycle_number),
        "slaves": f"{snapshot.slaves_found} of {snapshot.slaves_expected}",
        "interface": word(snapshot.links[0]),
        "clocks": word(snapshot.clock.state),
    }
    for domain in snapshot.domains:
        counter = f"{domain.wkc} of {domain.wkc_expected}"
        facts[f"working counter of domain {domain.number}"] = counter
    return facts | {
        name: str(value) for name, value in snapshot.counters.items() if name != "cycles"
    }


def _of_slave(bus: str, hardware: str, slave: SlaveInfo) -> Status:
    text = al_state_text(slave.al_state)
    level = Level.OK
    if slave.absent:
        text = "absent, which is allowed"
    elif slave.al_state != AlState.OP:
        level = Level.ERROR
        if slave.al_code:
            text += f": {al_status_text(slave.al_code)}"
    name = f"ecatd: bus {bus} slave {slave.position} {slave.name}".rstrip()
    facts = {
        "vendor": f"0x{slave.vendor:08X}",
        "product": f"0x{slave.product:08X}",
        "revision": f"0x{slave.revision:08X}",
        "serial": str(slave.serial),
    }
    return Status(level, name, text, hardware, facts)


def _of_joints(bus: str, hardware: str, joints: Joints) -> Status:
    missing = [f"joint '{name}' has no values that can be trusted" for name in joints.untrusted]
    problems = "; ".join((*joints.problems, *missing))
    text = problems or f"{len(joints.names)} joints"
    level = Level.WARN if problems else Level.OK
    return Status(level, f"ecatd: bus {bus} joints", text, hardware)
