"""The first steps of a start: prepares it, scans the bus, and reads its slaves, up to PREOP."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from ecatd.base.coroutine_steps import finish
from ecatd.base.errors import StateError, UnreachableError
from ecatd.base.log import Log
from ecatd.base.paths import profile_folders
from ecatd.config import Config
from ecatd.config.meanings import raw_parameters, unknown_types
from ecatd.config.profiles import Profiles, load_profiles
from ecatd.config.resolve import alike_slaves, check_slaves, load_description, with_can_objects
from ecatd.description.bus import Bus, Slave
from ecatd.description.conditions import Condition
from ecatd.etg.al import AlState
from ecatd.etg.sii import Sii
from ecatd.master.emergencies import log_emergencies
from ecatd.master.frames.identification import ask_identifications, ways_to_ask
from ecatd.master.master import Master

from .absent import may_be_empty, waits_for_slaves
from .clocks import clock_bits
from .expectation import STARTS_OTHERS, place
from .found_bus import FoundBus
from .mapping import configure_slaves, read_modules
from .matching import branch_ends
from .scanned import Scanned, identify_slaves
from .set_up import count_links, read_mailboxes
from .uncertain import settle


@dataclass(frozen=True, slots=True)
class Plan:
    """What a start knows before it sends anything.

    Attributes:
        config: The configuration, with the positions that it expects.
        interface: The interface, which may come from the simulator.
        profiles: The device profiles.
        description: The description of the complete bus; None if there is none.
        cancelled: Called while waiting for slaves; when it returns true, the start ends with
            `StateError`.
        log: The log for progress and warnings.
    """

    config: Config
    interface: str
    profiles: Profiles
    description: Bus | None
    cancelled: Callable[[], bool]
    log: Log


def prepare(config: Config, interface: str, cancelled: Callable[[], bool], log: Log) -> Plan:
    """Reads the files that the configuration names.

    Raises:
        ConfigError: A file cannot be read.
    """
    profiles, description = load_profiles(config, profile_folders()), load_description(config)
    for warning in alike_slaves(config):
        log.warning(warning)
    return Plan(config, interface, profiles, description, cancelled, log)


def scan(plan: Plan, master: Master, refused: dict[int, str]) -> FoundBus:
    """Finds the slaves, brings them to PREOP, and compares them with the expected ones.

    Args:
        plan: What is wanted.
        master: The master.
        refused: See `FoundBus`.

    Raises:
        StateError: The bus is not the expected one; or as `Master.scan`.
    """
    stuck = _bring_to_preop(plan, master)
    scanned = identify_slaves(master)
    for item in scanned:
        if why := stuck.get(item.slave.position):
            item.condition, item.why = Condition.STUCK, why
    for item in scanned:
        slave = item.slave
        plan.log.debug(
            f"{slave.label}: vendor 0x{slave.vendor:08X}, product 0x{slave.product:08X}, "
            f"revision 0x{slave.revision:08X}, serial number 0x{slave.serial:08X}, alias "
            f"{slave.alias}",
            slaves=[slave.position],
        )
    in_preop = [item for item in scanned if not item.condition]
    _identify(plan, master, in_preop)
    read_modules(master, in_preop, plan.cancelled)
    placed = place(master, scanned, plan.config, plan.description, plan.log)
    return FoundBus(
        Bus(plan.config.bus, plan.config.cycle_time_us),
        master,
        placed.config,
        placed.scanned,
        placed.expectation,
        placed.awaited,
        placed.unexpected,
        refused,
    )


def _bring_to_preop(plan: Plan, master: Master) -> dict[int, str]:
    """Scans; returns slaves that do not reach PREOP, by place on the wire, and their AL states."""
    config = plan.config
    try:
        why = master.scan(config.state_timeout, may_be_empty=may_be_empty(config, plan.description))
    except UnreachableError as error:
        if plan.description is None and waits_for_slaves(config):
            raise UnreachableError(
                f"{error}. A tolerant bus starts without its slaves and uses them when they come, "
                "if it has their `description` in [expected]"
            ) from error
        raise
    count = len(master.stations)
    text = f"{count} slave{'s' * (count != 1)} found on {plan.interface}"
    plan.log.info(f"{text} (numbered by ecatd: {why})" if why else text)
    stuck = {}
    for item in finish(master.al_states.request(AlState.PREOP, config.state_timeout)):
        if not item.al_state:  # it has lost its power or its cable
            raise StateError(f"slave {item.position} does not answer any more")
        stuck[item.position] = item.describe()
    return stuck


def read(plan: Plan, found: FoundBus) -> None:
    """Writes the configuration of each slave, and reads their PDOs into the bus description.

    Raises:
        StateError: Slaves cannot be read or configured.
        ConfigError: The configuration does not fit the slaves.
    """
    master, log = found.master, plan.log
    _leave_out_stuck(found)
    check_slaves(found.config, replace(found.bus, slaves=[item.slave for item in found.scanned]))
    for wanted in found.config.slave:
        if wanted.mailbox_tries is not None:
            master.set_mailbox_tries(wanted.position, wanted.mailbox_tries)
    _make_raw(found, plan.profiles)
    configure_slaves(master, found.scanned, found.config, found.unexpected, plan.cancelled)
    if any(item.silence for item in found.scanned) and master.find_gone():
        raise StateError("slaves have lost their power or their cable")
    mailbox_log = log.of("mailbox")
    for item in found.scanned:
        for text in item.refused:
            log.warning(text)
        for text in item.settled:
            log.info(text)
        log_emergencies(mailbox_log, [(item.slave, *emergency) for emergency in item.emergencies])
    said = {(rule.slave, rule.address) for rule in found.config.signal if rule.type}
    for item in found.scanned:
        configured = {address for at, address in said if at == item.slave.position}
        if not item.condition:
            for text in unknown_types(item.slave, item.guessed, configured):
                log.info(text)
    found.uncertain = settle(found, log)
    for position, bits in clock_bits(master).items():
        found.scanned[position].slave.dc_bits = bits
    found.bus.slaves = [item.slave for item in found.scanned]
    found.mailboxes = read_mailboxes(master)
    found.ends = _branch_ends(master, ring=bool(found.config.second_interface))


def _leave_out_stuck(found: FoundBus) -> None:
    """Goes on without the slaves that do not reach PREOP.

    Raises:
        StateError: The bus must not start without one of them.
    """
    stuck = [item for item in found.scanned if item.condition == Condition.STUCK]
    if must := [item for item in stuck if found.must_be_there(item.slave.position)]:
        texts = [
            f"{item.slave.label} does not reach PREOP: {item.why}"
            + "".join(f"; its EEPROM: {problem}" for problem in item.slave.problems)
            for item in must
        ]
        raise StateError(f"{'; '.join(texts)} ({STARTS_OTHERS})")


def _identify(plan: Plan, master: Master, scanned: Sequence[Scanned]) -> None:
    """Reads the identifications of the slaves."""
    ways = ways_to_ask(plan.config, ((item.slave, item.sii) for item in scanned))
    stations = master.stations
    asked = {stations[position]: register for position, register in ways.items()}
    told = ask_identifications(master.registers, asked) if asked else {}
    for item in scanned:
        item.slave.identification = told.get(item.slave.address, 0)


def _make_raw(found: FoundBus, profiles: Profiles) -> None:
    """Converts physical values of start-up parameters to raw values, before any is written.

    Device profiles are chosen by all PDOs of the EEPROM, since the assigned PDOs are not known yet.

    Raises:
        ConfigError: A value has no meaning, or does not fit.
    """
    raw = []
    for wanted in found.config.slave:
        if wanted.position < len(found.scanned):
            item = found.scanned[wanted.position]
            slave = with_eeprom_pdos(item.slave, item.sii)
            wanted = raw_parameters(wanted, slave, profiles, found.config.signal)
            wanted = with_can_objects(found.config, wanted, slave)
        raw.append(wanted)
    found.config = replace(found.config, slave=raw)


def with_eeprom_pdos(slave: Slave, sii: Sii) -> Slave:
    """Returns the slave with all PDOs of its EEPROM, by which its device profiles are chosen."""
    outputs, inputs = [*slave.outputs, *sii.outputs], [*slave.inputs, *sii.inputs]
    return replace(slave, outputs=outputs, inputs=inputs)


def _branch_ends(master: Master, *, ring: bool) -> list[int]:
    """Returns the `branch_ends` of the bus. If slaves are absent, the branches are unknown."""
    count = len(master.stations)
    if master.wire != [*range(count)]:
        return [position + 1 for position in range(count)]
    return branch_ends(count_links(master), ring=ring)
