"""Makes a configuration of what an ENI file says."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

from ecatd.base.errors import UsageError
from ecatd.config import Config, DcSlaveConfig, DomainConfig, Mark
from ecatd.config.clocks import SYNC_MAX_US
from ecatd.config.idns import startup_idn
from ecatd.config.slave_settings import (
    ALIAS,
    IDENTIFICATION_REGISTERS,
    ON_REQUEST,
    WATCHDOG_MAX_MS,
    WATCHDOG_MIN_MS,
    SlaveConfig,
)
from ecatd.config.startup import TRANSITIONS, startup_parameter
from ecatd.config.writer import Notes, unique_name
from ecatd.description.bus import Bus, Slave
from ecatd.description.limits import DOMAINS_MAX
from ecatd.description.object_types import ObjectTypes
from ecatd.etg.idns import idn_text

from ..esi.device import IdnCommand
from .network import CoeCommand, EniNetwork, EniSlave, EniTask, find_modules, is_about_modules
from .process_data import find_process_data, is_about_pdos
from .registers import Memory, Sync, whose
from .report import Report

_CYCLE_MIN_US, _CYCLE_MAX_US = 100, 1_000_000
_WATCHED = 0x40  # bit of a sync manager's control: its data feed the watchdog
_NAME = re.compile(r"(.*?)\s*[(\[]\s*([^()\[\]]+?)\s*[)\]]*\s*", re.DOTALL)
_USUAL = (0x0300, 0x0700)
_UNUSED = "entries of PDOs that are not assigned"
_MASTER = "commands for all slaves at once"


@dataclass(slots=True)
class Converted:
    """The result of the conversion of an ENI file.

    Attributes:
        config: The configuration.
        bus: The bus that it expects.
        notes: Comments for the configuration.
        report: What the configuration has of the file, and what it has not.
    """

    config: Config
    bus: Bus
    notes: Notes
    report: Report


def convert(network: EniNetwork, bus: str) -> Converted:
    """Makes a configuration of what an ENI file says.

    Args:
        network: The content of the file.
        bus: Name of the bus.
    """
    return _Converter(network, bus).run()


class _Converter:
    """Converts one network."""

    def __init__(self, network: EniNetwork, bus: str) -> None:
        self._network = network
        self._file = Path(network.path).name
        self._slaves = _behind(_in_order(network.slaves))
        self._memories = [Memory(slave) for slave in self._slaves]
        self._syncs = [memory.sync() for memory in self._memories]
        self._groups = _group_names(network.slaves)
        self._config = Config(bus=bus)
        self._bus = Bus(bus, self._config.cycle_time_us)
        self._notes = Notes([f"Made of {self._file}, the ENI file of '{network.name}'."])
        self._report = Report()

    def run(self) -> Converted:
        self._take_cycles()
        names: set[str] = set()
        marks: set[Mark] = set()
        for position, slave in enumerate(self._slaves):
            self._take_slave(position, slave, names, marks)
        self._take_clocks()
        if self._network.commands:
            self._report.ours[_MASTER] += self._network.commands
        for line, tag in self._network.others:
            self._report.leave(line, None, f"<{tag}> is not known")
        for line, text in self._network.findings.by_line:
            self._report.leave(line, None, text)
        for task in self._network.tasks:
            for line, tag in task.others:
                self._report.leave(
                    line, None, f"<{tag}>: the master copies no inputs of a slave to another one"
                )
        for remark in self._report.unsupported:
            where = self._notes.top
            if remark.slave is not None:
                where = self._notes.slaves.setdefault(remark.slave, [])
            where.append(f"Not taken from {self._file}, line {remark.line}: {remark.text}.")
        return Converted(self._config, self._bus, self._notes, self._report)

    # --- cycles and domains --------------------------------------------------------------------

    def _take_cycles(self) -> None:
        """Takes the cycle, and a domain for each cycle if slaves have several."""
        tasks = [task for task in self._network.tasks if task.cycle_us]
        if not tasks:
            self._guess_cycle()
            return
        members = self._members(tasks)
        base = math.gcd(*members)
        if base < _CYCLE_MIN_US or max(members) > _CYCLE_MAX_US:
            base = min(max(min(members), _CYCLE_MIN_US), _CYCLE_MAX_US)
            times = ", ".join(f"{cycle} µs" for cycle in members)
            self._report.leave(
                tasks[0].line,
                None,
                f"cycle times of {times}: all must be multiples of one cycle that is from "
                f"{_CYCLE_MIN_US} to {_CYCLE_MAX_US} µs, so the bus has {base} µs",
            )
            members = {base: []}
        self._config.cycle_time_us = self._bus.cycle_time_us = base
        if len(members) > DOMAINS_MAX:
            text = f"{len(members)} cycle times: {DOMAINS_MAX} domains are possible"
            self._report.leave(
                tasks[0].line, None, f"{text}, so the slowest slaves are in the first"
            )
        names = {task.cycle_us: task.name for task in reversed(tasks)}
        for cycle in sorted(members)[:DOMAINS_MAX] if len(members) > 1 else ():
            first = not self._config.domain  # this domain has all slaves that no other domain names
            name, slaves = self._domain_name(names[cycle]), [] if first else members[cycle]
            self._config.domain.append(DomainConfig(name, cycle // base, slaves=slaves))

    def _guess_cycle(self) -> None:
        """Takes the cycle of the SYNC signals."""
        cycles = {sync.cycle0_ns for sync in self._syncs if sync}
        cycle_us, rest = divmod(min(cycles, default=0), 1000)
        if rest == 0 and _CYCLE_MIN_US <= cycle_us <= _CYCLE_MAX_US:
            self._config.cycle_time_us = self._bus.cycle_time_us = cycle_us
            text = f"No <Cyclic> has a cycle time: {cycle_us} µs is that of SYNC0."
        else:
            text = f"It has no cycle time: {self._config.cycle_time_us} µs is the default."
        self._notes.top.append(text)

    def _members(self, tasks: list[EniTask]) -> dict[int, list[int]]:
        """The slaves that are exchanged in each cycle time, without cycles that exchange none."""
        members: dict[int, list[int]] = {}
        for position, memory in enumerate(self._memories):
            addresses = list(memory.logical_addresses())
            found = {
                task.cycle_us
                for task in tasks
                for start, length in task.areas
                if any(start <= at < start + length for at in addresses)
            }
            if found:
                members.setdefault(min(found), []).append(position)
            if len(found) > 1:
                self._report.leave(
                    self._slaves[position].line,
                    position,
                    "it is exchanged in several tasks, but a slave has one domain: that with "
                    f"{min(found)} µs",
                )
        return members or {min(task.cycle_us for task in tasks): []}

    def _domain_name(self, text: str) -> str:
        name = "".join(c for c in text if c.isprintable()).encode()[:31].decode("utf-8", "ignore")
        return "" if name in (domain.name for domain in self._config.domain) else name

    # --- slaves --------------------------------------------------------------------------------

    def _take_slave(
        self, position: int, slave: EniSlave, names: set[str], marks: set[Mark]
    ) -> None:
        given, kind = _split_name(slave.name)
        data = find_process_data(slave)
        description = Slave(
            position,
            kind,
            slave.vendor,
            slave.product,
            slave.revision,
            serial=slave.serial,
            coe=slave.coe,
            soe=slave.soe,
            given_name=unique_name(given, names),
        )
        if data.pdos is not None or not slave.coe:  # otherwise the writer would name all of them
            description.outputs, description.inputs = data.outputs, data.inputs
        settings = SlaveConfig(position)
        self._bus.slaves.append(description)
        self._config.slave.append(settings)
        self._report.take(position, "identity")
        if description.given_name != unique_name(given, set()):
            self._report.take(position, f"its name, with a number, as another slave is '{given}'")
        if slave.identification:
            self._take_identification(slave, settings, marks)
            description.alias = settings.alias or 0
            description.identification = settings.identification or 0
        if slave.group:
            settings.group, settings.optional = self._groups[slave.group], True
            self._report.take(position, f"hot connect group {settings.group}")
        self._report.ours[_UNUSED] += len(data.unused)
        for line, text in data.problems:
            self._report.leave(line, position, text)
        if slave.coe and data.pdos is not None:
            settings.pdos = data.pdos
            self._report.take(position, f"{len(data.pdos)} PDOs")
        settings.pdo = data.mappings if slave.coe else []
        if settings.pdo:
            self._report.take(position, f"entries of {len(settings.pdo)} PDOs")
        self._take_objects(slave, settings, description)
        self._take_idns(slave, settings)
        self._take_watchdogs(slave, settings, description)
        for command in slave.registers:
            what = whose(command)
            if what:
                self._report.ours[what] += 1
            else:
                comment = f" ({command.comment})" if command.comment else ""
                text = f"<InitCmd>{comment} for register 0x{command.register:04X}"
                self._report.leave(command.line, position, text)
        for line, tag in slave.others:
            self._report.leave(line, position, f"<{tag}>: there is no key for that")

    def _take_identification(
        self, slave: EniSlave, settings: SlaveConfig, marks: set[Mark]
    ) -> None:
        mark = _mark(slave)
        if slave.identification is None or mark is None:
            register, value = slave.identification or (0, 0)
            text = f"it is identified by {value} in register 0x{register:04X}, which tells nothing"
        elif mark in marks:
            text = f"it has the same {mark.kind} as another slave, {mark.value}"
        else:
            marks.add(mark)
            register, _ = slave.identification
            if register == ALIAS:
                settings.alias = mark.value
            else:
                settings.identification = mark.value
                settings.identification_register = None if register == ON_REQUEST else register
            self._report.take(settings.position, str(mark))
            return
        self._report.leave(slave.line, settings.position, f"{text}, so its position finds it")

    def _take_objects(self, slave: EniSlave, settings: SlaveConfig, description: Slave) -> None:
        types = ObjectTypes(description)
        late = ""
        settings.module = find_modules(slave.objects)
        if settings.module:
            count = len(settings.module)
            self._report.take(settings.position, f"{count} module{'s' * (count != 1)}")
        for command in slave.objects:
            if is_about_modules(command):
                continue
            what = f"<InitCmd> for {command.address}"
            if is_about_pdos(command):
                if late:
                    self._notes.slaves.setdefault(settings.position, []).append(
                        f"{late} is written before the PDOs in {self._file}. ecatd writes PS "
                        'parameters behind the PDOs: if the slave needs it before, write "IP".'
                    )
                    late = ""
                continue
            for transition in self._transitions(
                command, settings, what, "reads, and writes nothing"
            ):
                try:
                    parameter = startup_parameter(
                        types.find(command.index, command.subindex),
                        (command.index, command.subindex),
                        command.data,
                        complete=command.complete,
                        transition=transition,
                        comment=command.comment,
                    )
                except UsageError as error:
                    self._report.leave(command.line, settings.position, f"{what}: {error}")
                    break
                settings.startup.append(parameter)
                late = parameter.object if transition == "PS" and not late else late
        count = len(settings.startup)
        if count:
            self._report.take(settings.position, f"{count} start-up parameter{'s' * (count != 1)}")

    def _transitions(
        self, command: CoeCommand | IdnCommand, settings: SlaveConfig, what: str, nothing: str
    ) -> list[str]:
        """The transitions in which ecatd writes a command; the report names the others."""
        if command.disabled or not command.data:
            why = "is switched off" if command.disabled else nothing
            self._report.leave(command.line, settings.position, f"{what} {why}")
            return []
        others = [name for name in command.transitions if name not in TRANSITIONS]
        if others or not command.transitions:
            text = f"{what} in transition {', '.join(others) or 'none'}"
            self._report.leave(command.line, settings.position, text)
        return [name for name in TRANSITIONS if name in command.transitions]

    def _take_idns(self, slave: EniSlave, settings: SlaveConfig) -> None:
        for command in slave.idns:
            what = f"<InitCmd> for {idn_text(command.idn)} of drive {command.drive}"
            for transition in self._transitions(command, settings, what, "writes no value"):
                try:
                    parameter = startup_idn(
                        command.idn,
                        command.drive,
                        command.data,
                        transition=transition,
                        comment=command.comment,
                    )
                except UsageError as error:
                    self._report.leave(command.line, settings.position, f"{what}: {error}")
                    break
                settings.idn.append(parameter)
        if count := len(settings.idn):
            self._report.take(settings.position, f"{count} IDN{'s' * (count != 1)}")

    def _take_watchdogs(self, slave: EniSlave, settings: SlaveConfig, description: Slave) -> None:
        outputs = [item for item in slave.sync_managers if item.outputs and item.pdos]
        off = bool(outputs) and not any(item.control & _WATCHED for item in outputs)
        data, pdi = self._memories[settings.position].watchdogs_ms()
        if off:
            description.watchdog_ms = 0.0
            settings.watchdog_ms = 0.0
            self._report.take(settings.position, "watchdog off")
        elif data is not None and (outputs or slave.output_bits != 0):
            settings.watchdog_ms = self._watchdog(slave, settings, "watchdog", data)
        if pdi is not None:
            settings.pdi_watchdog_ms = self._watchdog(slave, settings, "PDI watchdog", pdi)

    def _watchdog(
        self, slave: EniSlave, settings: SlaveConfig, what: str, time: float
    ) -> float | None:
        rounded = round(time, 1)
        if rounded > WATCHDOG_MAX_MS or (time and rounded < WATCHDOG_MIN_MS):
            text = (
                f"a {what} of {time:g} ms: {WATCHDOG_MIN_MS:g} to {WATCHDOG_MAX_MS:g} are allowed"
            )
            self._report.leave(slave.line, settings.position, text)
            return None
        self._report.take(settings.position, f"{what} of {rounded:g} ms")
        return rounded

    # --- clocks --------------------------------------------------------------------------------

    def _take_clocks(self) -> None:
        dc = self._config.dc
        dc.reference = self._reference()
        if dc.reference >= 0 and self._config.slave[dc.reference].optional:
            text = (
                "it is the reference clock, but it may be absent: the first other clock takes "
                "its place"
            )
            self._report.leave(self._slaves[dc.reference].line, dc.reference, text)
            dc.reference, dc.enabled = -1, True
        for position, sync in enumerate(self._syncs):
            if sync is not None:
                self._take_sync(position, sync)
            elif (clock := self._slaves[position].clock) and clock.cycle0_ns:
                self._report.leave(
                    clock.line,
                    position,
                    "<CycleTime0> of <DC>, since no <InitCmd> starts SYNC signals (0x0980)",
                )
        dc.enabled |= bool(dc.slave) or dc.reference >= 0
        if dc.reference >= 0:
            self._report.take(dc.reference, "reference clock")

    def _reference(self) -> int:
        """Position of the reference clock, -1 if the file names none."""
        for position, slave in enumerate(self._slaves):
            if slave.clock is not None and slave.clock.reference:
                return position
        clocks = {task.clock for task in self._network.tasks} - {None}
        for position, slave in enumerate(self._slaves):
            if slave.clock is not None and {slave.address, slave.auto_increment} & clocks:
                return position
        return -1

    def _take_sync(self, position: int, sync: Sync) -> None:
        slave = self._slaves[position]
        line = slave.clock.line if slave.clock else slave.line
        domain_ns = self._config.domain_cycle_us(position) * 1000
        cycle = sync.cycle0_ns
        if cycle == 0 or (cycle % domain_ns and domain_ns % cycle):
            text = (
                f"SYNC0 every {cycle / 1000:g} µs: it must be a multiple or a whole fraction of "
                f"the cycle of the slave, {domain_ns // 1000} µs"
            )
            self._report.leave(line, position, text)
            return
        times = (cycle, abs(sync.shift_ns), sync.sync1_ns)
        if max(times) > SYNC_MAX_US * 1000:
            text = f"SYNC signals with times of more than {SYNC_MAX_US} µs"
            self._report.leave(line, position, text)
            return
        self._config.dc.slave.append(
            DcSlaveConfig(
                position,
                0.0 if cycle == domain_ns else cycle / 1000,
                sync.shift_ns / 1000 if sync.shift_ns else None,
                sync.sync1_ns / 1000,
            )
        )
        self._report.take(position, f"SYNC0 every {cycle / 1000:g} µs")
        notes = self._notes.clocks.setdefault(position, [])
        if not sync.shift_ns:
            notes.append(
                f"{self._file} has no shift. Frames leave at the start of the cycle here, so SYNC0 "
                "comes half a cycle later."
            )
        if sync.activation not in _USUAL:
            notes.append(
                f"{self._file} has AssignActivate 0x{sync.activation:04X}; ecatd takes it from the "
                "EEPROM of the slave, else it is 0x0300, or 0x0700 with SYNC1."
            )


def _in_order(slaves: list[EniSlave]) -> list[EniSlave]:
    """The slaves in the order of the wire, if the auto-increment addresses give all of it."""
    known = [slave for slave in slaves if slave.auto_increment is not None]
    places = {-(slave.auto_increment or 0) & 0xFFFF: slave for slave in known}
    if sorted(places) == list(range(len(slaves))):
        return [places[position] for position in range(len(slaves))]
    return slaves


def _mark(slave: EniSlave) -> Mark | None:
    """The mark that finds the slave wherever it stands; None if no slave can have such a mark."""
    register, value = slave.identification or (0, 0)
    if not value or register not in IDENTIFICATION_REGISTERS:
        return None
    return Mark("station alias" if register == ALIAS else "identification", value)


def _behind(slaves: list[EniSlave]) -> list[EniSlave]:
    """Puts groups that are found by a mark behind all others, as the configuration does."""
    heads = (slave for slave in slaves if slave.group_name is not None)
    found = {slave.group for slave in heads if _mark(slave) is not None}
    return sorted(slaves, key=lambda slave: slave.group if slave.group in found else 0)


def _group_names(slaves: list[EniSlave]) -> dict[int, str]:
    """A unique name for each hot connect group, by its number."""
    taken: set[str] = set()
    heads = [slave for slave in slaves if slave.group_name is not None]
    return {head.group: unique_name(head.group_name or "group", taken) for head in heads}


def _split_name(text: str) -> tuple[str, str]:
    """Name and order code in a name such as `Term 2 (EL1008)` or `Axis [AX2]`."""
    match = _NAME.fullmatch(text)
    if match and match[1]:
        return match[1], match[2]
    return text, ""
