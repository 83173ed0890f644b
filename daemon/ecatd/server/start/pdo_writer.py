"""Writes the PDO assignment and the PDO mappings of a slave (ETG.1000.6).

They are written only where they differ from those of the slave, since some slaves refuse writes to
objects that they cannot change. Before that, they are compared with the PDOs in the EEPROM and with
the dictionary, as far as these describe them. The count of an assignment or mapping is set to 0
before it is written. If the slave then refuses something, what it has changed is restored:
otherwise it would go on without some of its PDOs, for no visible reason.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

from ecatd.base.errors import NoAnswerError, SdoAbortError, StateError
from ecatd.config import PdoConfig
from ecatd.config.pdos import INPUT_PDOS
from ecatd.config.resolve.pdos import (
    ASSIGNMENT,
    chosen_from_eeprom,
    fixed_text,
    indices_text,
    no_channel_text,
)
from ecatd.etg import error_codes
from ecatd.etg.pdo import Pdo
from ecatd.etg.sii import UNASSIGNED, USAGE_INPUTS, USAGE_OUTPUTS
from ecatd.master.mailbox.coe import Coe
from ecatd.master.mailbox.conversation import Conversation
from ecatd.master.mailbox.sdo_information import (
    INPUT_OBJECTS,
    OUTPUT_OBJECTS,
    describe_entry,
    list_objects,
)

from .assignment import INFORMATION, Assignment
from .object_access import RefusedError, write
from .scanned import Scanned, SlaveMailbox

_MISSING = (error_codes.NO_OBJECT, error_codes.NO_SUBINDEX)
_OFFERED_MOST = 24
"""Most objects that a message names."""

Mapping = list[tuple[int, int, int]]
"""Index, subindex and bits of each entry of a PDO."""


class PdoWriter(SlaveMailbox):
    """Writes assignment and mappings of one slave with CoE, as configured.

    Args:
        item: The slave.
        coe: A conversation with it.
        log_detail: Called with a description of each write.
    """

    def __init__(self, item: Scanned, coe: Coe, log_detail: Callable[[str], None]) -> None:
        super().__init__(item, coe)
        self._log_detail = log_detail
        self._assignment = Assignment(item, coe)
        self._written: set[int] = set()  # objects that the slave has changed

    def write(self) -> Conversation[None]:
        """Writes the PDOs, and reads them back; a part of a conversation.

        Raises:
            RefusedError: The slave does not have these PDOs, or refuses them.
            NoAnswerError: It does not answer.
            StateError: Its answers are malformed.
        """
        outputs, inputs = yield from self._assignment.pdos()
        before = {pdo.index: pdo for pdo in (*outputs, *inputs)}
        wanted = self._wanted(before)
        old = yield from self._changed_mappings(before)
        new = {pdo.index: _configured(pdo) for pdo in self._settings.mapped if pdo.index in old}
        for index, mapping in new.items():
            yield from self._check_entries(index, mapping)
        had = {
            number: [pdo.index for pdo in before.values() if pdo.sync_manager == number]
            for number in wanted
        }
        managers = [
            number
            for number, indices in wanted.items()
            if indices != had[number] or any(index in new for index in indices)
        ]
        try:
            yield from self._write_all({number: wanted[number] for number in managers}, new)
            yield from self._verify(wanted)
        except RefusedError as error:
            try:
                yield from self._write_all(
                    {n: had[n] for n in managers if ASSIGNMENT + n in self._written},
                    {index: mapping for index, mapping in old.items() if index in self._written},
                )
            except RefusedError as worse:
                if (yield from self._assignment.pdos()) == (outputs, inputs):
                    raise error from worse
                raise RefusedError(
                    self._slave,
                    f"{error.why}; then it did not take back the PDOs that it had: it "
                    f"{worse.why}; switch its power off and on",
                ) from error
            raise

    # --- what is wanted ------------------------------------------------------------------------

    def _wanted(self, before: dict[int, Pdo]) -> dict[int, list[int]]:
        """Returns the configured assignment: the indices of the PDOs, by sync manager.

        Raises:
            RefusedError: The slave has no sync manager for a PDO.
        """
        channels = {usage: self._sii.channels(usage) for usage in (USAGE_OUTPUTS, USAGE_INPUTS)}
        wanted: dict[int, list[int]] = {
            number: [] for numbers in channels.values() for number in numbers
        }
        places = {pdo.index: pdo.sync_manager for pdo in (*self._sii.outputs, *self._sii.inputs)}
        places |= {index: pdo.sync_manager for index, pdo in before.items()}
        indices = list(before) if self._settings.pdos is None else self._settings.pdos
        for index in indices:
            usage = USAGE_INPUTS if index >= INPUT_PDOS.start else USAGE_OUTPUTS
            number = places.get(index, UNASSIGNED)
            if number not in channels[usage]:
                if not channels[usage]:
                    raise RefusedError(self._slave, no_channel_text(index, usage))
                number = channels[usage][0]
            wanted[number].append(index)
        return wanted

    def _changed_mappings(self, before: dict[int, Pdo]) -> Conversation[dict[int, Mapping]]:
        """Reads the mappings of the slave that differ from the configured ones, by PDO index.

        Raises:
            RefusedError: The slave cannot change such a mapping.
        """
        changed = {}
        for pdo in self._settings.mapped:
            if pdo.index in before:
                now = before[pdo.index]
            else:
                try:
                    now = yield from self._assignment.pdo(pdo.index, UNASSIGNED)
                except SdoAbortError:  # perhaps it can be written
                    now = Pdo(pdo.index, "", UNASSIGNED, [])
            if _configured(pdo) == _mapping(now):
                continue
            if pdo.index in self._sii.fixed:
                raise RefusedError(self._slave, fixed_text(pdo.index))
            changed[pdo.index] = _mapping(now)
        return changed

    # --- what is offered -----------------------------------------------------------------------

    def _check_entries(self, index: int, mapping: Mapping) -> Conversation[None]:
        """Checks the entries of a PDO against the dictionary of the slave, if it describes it.

        Raises:
            RefusedError: An entry does not exist, or is too short.
        """
        if not self._sii.coe & INFORMATION:
            return
        for object_, subindex, bits in mapping:
            if not object_:
                continue
            entry = f"0x{object_:04X}:{subindex:02X}"
            try:
                described = yield from describe_entry(self._coe, object_, subindex, 1)
            except SdoAbortError as abort:
                if abort.code in _MISSING and not (yield from self._exists(object_, subindex)):
                    raise RefusedError(
                        self._slave,
                        f"has no {entry}, which PDO 0x{index:04X} shall map"
                        f"{yield from self._mappable(index)}",
                    ) from abort
                continue
            except (NoAnswerError, StateError):
                return  # its SDO information service does not work
            if 0 < described.bit_length < bits:
                raise RefusedError(
                    self._slave,
                    f"has {entry} with {described.bit_length} bits, and PDO 0x{index:04X} shall "
                    f"map {bits} of it: correct its bits",
                )

    def _exists(self, index: int, subindex: int) -> Conversation[bool]:
        """Whether an object exists that the slave does not describe; some describe only a part."""
        try:
            yield from self._coe.upload(index, subindex)
        except SdoAbortError as abort:
            return abort.code not in _MISSING
        return True

    def _mappable(self, pdo: int) -> Conversation[str]:
        """Returns the objects that the slave can map into a PDO, for the end of a message."""
        kind = INPUT_OBJECTS if pdo >= INPUT_PDOS.start else OUTPUT_OBJECTS
        found: list[int] = []
        if self._sii.coe & INFORMATION:
            with suppress(SdoAbortError, NoAnswerError, StateError):
                found = yield from list_objects(self._coe, 1, kind)
        if not found:
            return ""
        more = f" and {len(found) - _OFFERED_MOST} more" if len(found) > _OFFERED_MOST else ""
        return f"; it can map {indices_text(found[:_OFFERED_MOST])}{more}"

    def _offer(self, index: int) -> str:
        """Returns the PDOs of the same direction in the slave's EEPROM, for messages."""
        pdos = self._sii.inputs if index >= INPUT_PDOS.start else self._sii.outputs
        offered = ", ".join(f"0x{pdo.index:04X}" for pdo in pdos)
        return f" (its EEPROM offers {offered})" if offered else ""

    # --- writing -------------------------------------------------------------------------------

    def _write_all(
        self, assignments: dict[int, list[int]], mappings: dict[int, Mapping]
    ) -> Conversation[None]:
        """Writes the assignments of sync managers, by number, and mappings of PDOs, by index."""
        for number in assignments:
            yield from self._write(ASSIGNMENT + number, 0, "B", 0, "its PDO assignment")
        for index, mapping in mappings.items():
            yield from self._write_mapping(index, mapping)
        for number, indices in assignments.items():
            for at, index in enumerate(indices, 1):
                yield from self._write(
                    ASSIGNMENT + number, at, "H", index, f"PDO 0x{index:04X}{self._offer(index)}"
                )
            count = len(indices)
            yield from self._write(
                ASSIGNMENT + number, 0, "B", count, f"an assignment of {count} PDOs"
            )

    def _write_mapping(self, index: int, mapping: Mapping) -> Conversation[None]:
        pdo = f"PDO 0x{index:04X}"
        yield from self._write(index, 0, "B", 0, f"another mapping of {pdo}")
        for number, (object_, subindex, bits) in enumerate(mapping, 1):
            entry = f"0x{object_:04X}:{subindex:02X}" if object_ else "a gap"
            value = object_ << 16 | subindex << 8 | bits
            what = f"entry {number} of {pdo} ({entry}, {bits} bits)"
            try:
                yield from self._write(index, number, "I", value, what)
            except RefusedError as error:
                more = yield from self._mappable(index)
                raise RefusedError(self._slave, f"{error.why}{more}") from error
        yield from self._write(index, 0, "B", len(mapping), f"{pdo} with {len(mapping)} entries")

    def _write(
        self, index: int, subindex: int, form: str, value: int, what: str
    ) -> Conversation[None]:
        self._log_detail(what)
        yield from write(self._slave, self._coe, (index, subindex), form, value, what)
        self._written.add(index)

    def _verify(self, wanted: dict[int, list[int]]) -> Conversation[None]:
        """Reads the PDOs back, since some slaves accept writes without using them.

        Raises:
            RefusedError: The slave has other PDOs, or other mappings.
        """
        outputs, inputs = yield from self._assignment.pdos()
        own = {pdo.index: pdo for pdo in self._settings.mapped}
        for number, indices in wanted.items():
            now = [pdo for pdo in (*outputs, *inputs) if pdo.sync_manager == number]
            if [pdo.index for pdo in now] != indices:
                raise RefusedError(
                    self._slave,
                    f"has accepted the PDOs {indices_text(indices)} in sync manager {number}, "
                    f"but has {indices_text([pdo.index for pdo in now])}",
                )
            for pdo in now:
                if pdo.index in own and _mapping(pdo) != _configured(own[pdo.index]):
                    raise RefusedError(
                        self._slave,
                        f"has accepted the mapping of PDO 0x{pdo.index:04X}, but has another one",
                    )


def choose_from_sii(item: Scanned) -> None:
    """Sets the PDOs of a slave without CoE to those of its SII that are configured.

    Raises:
        ConfigError: The SII has no such PDO.
    """
    slave, sii, settings = item.slave, item.sii, item.settings
    if settings.pdos is None:
        return
    chosen = chosen_from_eeprom(slave, sii, settings)
    for pdo in chosen:
        if pdo.sync_manager == UNASSIGNED:
            usage = USAGE_INPUTS if pdo.index >= INPUT_PDOS.start else USAGE_OUTPUTS
            pdo.sync_manager = sii.channels(usage)[0]
    slave.outputs = [pdo for pdo in chosen if pdo.index < INPUT_PDOS.start]
    slave.inputs = [pdo for pdo in chosen if pdo.index >= INPUT_PDOS.start]


def note_no_process_data(item: Scanned) -> list[str]:
    """Returns what to say of a slave that describes its PDOs nowhere; a coupler may have none."""
    slave, sii, settings = item.slave, item.sii, item.settings
    if settings.pdos is not None or settings.mapped:
        return []
    if any(pdo.entries for pdo in (*slave.outputs, *slave.inputs, *sii.outputs, *sii.inputs)):
        return []
    return [
        f"{slave.label} has no process data: neither its PDO assignment nor its EEPROM names PDOs. "
        "If it should have some, plug in its modules, or write the `pdos` and the [[slave.pdo]] "
        "tables of its manual into its [[slave]] table"
    ]


def warn_of_no_direction(item: Scanned) -> list[str]:
    """Returns warnings about a slave without process data in a direction in which it has PDOs.

    This happens when a program has begun to write its PDO assignment, and has not finished.
    """
    slave, sii, settings = item.slave, item.sii, item.settings
    if settings.pdos is not None or settings.mapped:
        return []
    return [
        f"{slave.label} has no {what} now, though its EEPROM assigns {indices_text(offered)}: "
        "switch its power off and on, or name the PDOs in its [[slave]] table"
        for what, pdos, offers in (
            ("outputs", slave.outputs, sii.outputs),
            ("inputs", slave.inputs, sii.inputs),
        )
        if not any(pdo.entries for pdo in pdos)
        and (offered := [p.index for p in offers if p.entries and p.sync_manager != UNASSIGNED])
    ]


def _configured(pdo: PdoConfig) -> Mapping:
    return [(*entry.address, entry.bits) for entry in pdo.entries]


def _mapping(pdo: Pdo) -> Mapping:
    return [(entry.index, entry.subindex, entry.bit_length) for entry in pdo.entries]
