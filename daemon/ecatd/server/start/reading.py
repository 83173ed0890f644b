"""Scans a bus and reads its slaves into the bus description. They stay in PREOP."""

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
from ecatd.config.resolve import check_slaves, load_description
from ecatd.description.bus import Bus, Slave
from ecatd.description.conditions import Condition
from ecatd.etg.al import AlState
from ecatd.etg.sii import Sii
from ecatd.master.emergencies import tell_emergencies
from ecatd.master.frames.identification import ask_identifications, ways_to_ask
from ecatd.master.master import Master

from .absent import may_be_empty, waits_for_slaves
from .clocks import clock_bits
from .expectation import follow_expectation
from .found import STARTS_OTHERS, FoundBus
from .gone import find_gone
from .mapping import Scanned, configure_slaves, identify_slaves, read_modules
from .matching import branch_ends
from .set_up import count_links, read_mailboxes
from .uncertain import settle


@dataclass(frozen=True, slots=True)
class Files:
    """The contents of the files that the configuration names.

    Attributes:
        profiles: The device profiles.
        description: The description of the complete bus; None if there is none.
    """

    profiles: Profiles
    description: Bus | None


def read_files(config: Config) -> Files:
    """Reads the files that the configuration names.

    Raises:
        ConfigError: A file cannot be read.
    """
    return Files(load_profiles(config, profile_folders()), load_description(config))


def scan(found: FoundBus, interface: str, files: Files, log: Log) -> None:
    """Finds the slaves and brings them to PREOP; raises as `Master.scan`."""
    master, config = found.master, found.config
    empty = may_be_empty(config, files.description)
    try:
        why = master.scan(config.state_timeout, may_be_empty=empty)
    except UnreachableError as error:
        if files.description is None and waits_for_slaves(config):
            raise UnreachableError(
                f"{error}. A tolerant bus starts without its slaves and uses them when they come, "
                "if it has their `description` in [expected]"
            ) from error
        raise
    count = len(master.stations)
    text = f"{count} slave{'s' * (count != 1)} found on {interface}"
    log.info(f"{text} (numbered by ecatd: {why})" if why else text)
    for item in finish(master.al_states.request(AlState.PREOP, config.state_timeout)):
        if not item.al_state:  # it has lost its power or its cable
            raise StateError(f"slave {item.position} does not answer any more")
        found.stuck[item.position] = item.describe()


def read(found: FoundBus, files: Files, cancelled: Callable[[], bool], log: Log) -> None:
    """Reads SII and PDOs of all slaves, compares them, and writes the configuration of each slave.

    Raises:
        StateError: The bus is not the expected one, or slaves cannot be read or configured.
        ConfigError: The configuration does not fit the slaves.
    """
    master = found.master
    scanned = identify_slaves(master)
    for item in scanned:
        if why := found.stuck.get(item.slave.position):
            item.condition, item.why = Condition.STUCK, why
    for item in scanned:
        slave = item.slave
        log.debug(
            f"{slave.label}: vendor 0x{slave.vendor:08X}, product 0x{slave.product:08X}, "
            f"revision 0x{slave.revision:08X}, serial number 0x{slave.serial:08X}, alias "
            f"{slave.alias}",
            slaves=[slave.position],
        )
    in_preop = [item for item in scanned if not item.condition]
    _identify(found, in_preop)
    read_modules(master, in_preop, cancelled)
    unexpected = follow_expectation(found, scanned, files.description, log)
    _leave_out_stuck(found)
    check_slaves(found.config, replace(found.bus, slaves=[item.slave for item in found.scanned]))
    for wanted in found.config.slave:
        if wanted.mailbox_tries is not None:
            master.set_mailbox_tries(wanted.position, wanted.mailbox_tries)
    _make_raw(found, files.profiles)
    configure_slaves(master, found.scanned, found.config, unexpected, cancelled)
    if any(item.silence for item in found.scanned) and find_gone(master):
        raise StateError("slaves have lost their power or their cable")
    mailbox_log = log.of("mailbox")
    for item in found.scanned:
        for text in item.refused:
            log.warning(text)
        for text in item.settled:
            log.info(text)
        tell_emergencies(mailbox_log, [(item.slave, *emergency) for emergency in item.emergencies])
    said = {(rule.slave, rule.address) for rule in found.config.signal if rule.type}
    for item in found.scanned:
        configured = {address for at, address in said if at == item.slave.position}
        if not item.condition:
            for text in unknown_types(item.slave, item.guessed, configured):
                log.info(text)
    patience = found.config.state_timeout
    with_sync = {item.slave for item in found.config.dc.slave}
    dispensable = {
        item.slave.position
        for item in found.scanned
        if item.known and not found.must_be_there(item.slave.position)
    }
    found.uncertain = settle(
        *(master, found.scanned, unexpected, with_sync, dispensable, found.refused),
        *(patience, log.warning),
    )
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


def _identify(found: FoundBus, scanned: Sequence[Scanned]) -> None:
    """Reads the identifications of the slaves."""
    ways = ways_to_ask(found.config, ((item.slave, item.sii) for item in scanned))
    stations = found.master.stations
    asked = {stations[position]: register for position, register in ways.items()}
    told = ask_identifications(found.master.registers, asked) if asked else {}
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
