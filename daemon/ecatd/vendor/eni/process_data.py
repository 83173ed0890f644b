"""Finds the PDO assignment and the mappings of a slave in an ENI file (ETG.1000.6).

They are in the objects that the CoE commands write, 0x1C10 and following for the assignment, 0x1600
and 0x1A00 and following for the mappings. `<ProcessData>` has the rest.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from ecatd.config.pdos import (
    ENTRIES_MAX,
    INPUT_PDOS,
    OUTPUT_PDOS,
    PDOS_MAX,
    PdoConfig,
    PdoEntryConfig,
)
from ecatd.etg.datatypes import type_of_bits
from ecatd.etg.pdo import Entry, Pdo
from ecatd.etg.sii import UNASSIGNED

from .network import CoeCommand, EniSlave

_ASSIGNMENTS = range(0x1C10, 0x1C30)
_UP = {"IP", "PS", "PP", "SO"}


@dataclass(slots=True)
class ProcessData:
    """The process data of a slave.

    Attributes:
        pdos: The assignment; None if the file does not say all of it.
        mappings: Mappings that the file writes into PDOs.
        outputs: RxPDOs that are exchanged, as far as they are known.
        inputs: TxPDOs that are exchanged.
        unused: Indices of PDOs into which the file maps entries although it does not assign them.
        problems: Line and text of the parts that the configuration cannot have.
    """

    pdos: list[int] | None = None
    mappings: list[PdoConfig] = field(default_factory=list)
    outputs: list[Pdo] = field(default_factory=list)
    inputs: list[Pdo] = field(default_factory=list)
    unused: list[int] = field(default_factory=list)
    problems: list[tuple[int, str]] = field(default_factory=list)


def is_about_pdos(command: CoeCommand) -> bool:
    """Whether a command writes an assignment or a mapping on the way to OP."""
    return (
        (command.index in _ASSIGNMENTS or command.index in (*OUTPUT_PDOS, *INPUT_PDOS))
        and bool(command.data)
        and not command.disabled
        and not _UP.isdisjoint(command.transitions)
    )


def find_process_data(slave: EniSlave) -> ProcessData:
    """Finds the process data of a slave."""
    found = ProcessData()
    written: dict[int, dict[int, int]] = {}
    lines: dict[int, int] = {}
    for command in filter(is_about_pdos, slave.objects):
        lines[command.index] = command.line
        if not _write(written.setdefault(command.index, {}), command):
            found.problems.append(
                (command.line, f"{command.address} is written with {len(command.data)} bytes")
            )
    values: dict[int, list[int]] = {}
    for index, entries in written.items():
        count = entries.get(0, max(entries, default=0))
        missing = [number for number in range(1, count + 1) if number not in entries]
        if missing:
            text = f"0x{index:04X} gets {count} entries, but not entry {missing[0]}"
            found.problems.append((lines[index], text))
        else:
            values[index] = [entries[number] for number in range(1, count + 1)]
    outputs = _assigned(slave, values, outputs=True)
    inputs = _assigned(slave, values, outputs=False)
    _take_assignment(slave, found, outputs, inputs, lines)
    _take_mappings(found, values, lines)
    known = {(e.index, e.subindex): e for p in (*slave.outputs, *slave.inputs) for e in p.entries}
    own = {pdo.index: pdo for pdo in found.mappings}
    described = {pdo.index: pdo for pdo in (*slave.outputs, *slave.inputs)}
    for indices, pdos in ((outputs, found.outputs), (inputs, found.inputs)):
        for index in indices or ():
            pdo = described.get(index) or Pdo(index, "", UNASSIGNED)
            if index in own:
                pdo = replace(pdo, entries=[_entry(e, known) for e in own[index].entries])
            pdos.append(pdo)
    return found


def _write(entries: dict[int, int], command: CoeCommand) -> bool:
    """Carries a command out on the entries of an object; returns false if its data do not fit."""
    size = 2 if command.index in _ASSIGNMENTS else 4
    data, number = command.data, command.subindex
    if command.complete and number == 0:  # the count has 16 bits then
        entries[0] = data[0]
        data, number = data[2:], 1
    elif number == 0:
        entries[0] = data[0]
        return not any(data[1:])
    elif not command.complete and len(data) != size:
        return False
    for at in range(0, len(data), size):
        entries[number] = int.from_bytes(data[at : at + size], "little")
        number += 1
    return len(data) % size == 0 and number <= 0x100


def _assigned(slave: EniSlave, values: dict[int, list[int]], *, outputs: bool) -> list[int] | None:
    """The PDOs of one direction; None if the file does not say which."""
    managers = {item.number: item.outputs for item in slave.sync_managers}
    assigned = [
        indices
        for object_, indices in sorted(values.items())
        if object_ in _ASSIGNMENTS
        and _carries_outputs(object_ - _ASSIGNMENTS.start, indices, managers) == outputs
    ]
    if assigned:
        return [index for indices in assigned for index in indices]
    listed = [i for item in slave.sync_managers if item.outputs == outputs for i in item.pdos]
    described = slave.outputs if outputs else slave.inputs
    listed = listed or [pdo.index for pdo in described if pdo.sync_manager != UNASSIGNED]
    bits = slave.output_bits if outputs else slave.input_bits
    return listed if listed or bits == 0 else None


def _carries_outputs(number: int, indices: list[int], managers: dict[int, bool]) -> bool:
    """Whether a sync manager carries outputs; by convention those with even numbers do."""
    if indices:
        return indices[0] < INPUT_PDOS.start
    return managers.get(number, number % 2 == 0)


def _take_assignment(
    slave: EniSlave,
    found: ProcessData,
    outputs: list[int] | None,
    inputs: list[int] | None,
    lines: dict[int, int],
) -> None:
    line = next((n for index, n in lines.items() if index in _ASSIGNMENTS), slave.line)
    if outputs is None or inputs is None:
        if outputs or inputs:
            known = ", ".join(f"0x{index:04X}" for index in (outputs or inputs or ()))
            other = "outputs" if outputs is None else "inputs"
            found.problems.append(
                (line, f"the PDOs {known} are assigned, but the file does not say which PDOs carry "
                 f"{other}: write pdos with all of them")
            )  # fmt: skip
        return
    pdos = outputs + inputs
    strange = [index for index in pdos if index not in (*OUTPUT_PDOS, *INPUT_PDOS)]
    if strange:
        found.problems.append((line, f"0x{strange[0]:04X} is assigned, which is not a PDO"))
    elif len(set(pdos)) < len(pdos):
        found.problems.append((line, "one PDO is assigned twice"))
    elif len(pdos) > PDOS_MAX:
        found.problems.append((line, f"{len(pdos)} PDOs are assigned: at most {PDOS_MAX} can be"))
    else:
        found.pdos = pdos


def _take_mappings(found: ProcessData, values: dict[int, list[int]], lines: dict[int, int]) -> None:
    for index, entries in sorted(values.items()):
        if index in _ASSIGNMENTS:
            continue
        if found.pdos is not None and index not in found.pdos:
            found.unused.append(index)
            continue
        mapping = [_mapped(value) for value in entries]
        if len(mapping) > ENTRIES_MAX or not all(entry.bits for entry in mapping):
            text = f"PDO 0x{index:04X} gets an entry of 0 bits, or too many entries"
            found.problems.append((lines[index], text))
        else:
            found.mappings.append(PdoConfig(index, mapping))


def _mapped(value: int) -> PdoEntryConfig:
    index, subindex, bits = value >> 16, value >> 8 & 0xFF, value & 0xFF
    return PdoEntryConfig(bits, f"0x{index:04X}:{subindex:02X}" if index else None)


def _entry(entry: PdoEntryConfig, known: dict[tuple[int, int], Entry]) -> Entry:
    same = known.get(entry.address)
    if same is not None and same.bit_length == entry.bits:
        return same
    return Entry(*entry.address, same.name if same else "", type_of_bits(entry.bits), entry.bits)
