"""Reads the telegrams of drives with SoE: what their process data are (IEC 61800-7-204).

A drive writes the AT (drive telegram) and reads the MDT (master data telegram). S-0-0016 and
S-0-0024 list the IDNs behind the status word and the control word, which always come first. In
ecatd they are PDOs, as in ESI files and EEPROMs: drive n has MDT 0x0018 + 0x1000 * n and AT
0x0010 + 0x1000 * n. The index of an entry is its IDN. Its subindex is that of the EEPROM, or else
the number of the drive.
"""

from __future__ import annotations

from dataclasses import replace

from ecatd.base.errors import StateError
from ecatd.config.idns import DRIVES
from ecatd.config.resolve.believed import Believed, Reported, believe
from ecatd.description.units import modelica_unit
from ecatd.description.witnesses import other_idns
from ecatd.etg.datatypes import DataType
from ecatd.etg.idns import (
    AT_LIST,
    CONTROL,
    MDT_LIST,
    STATUS,
    TELEGRAM_TYPE,
    IdnValue,
    idn_text,
    telegram_index,
)
from ecatd.etg.pdo import Entry, Pdo
from ecatd.etg.sii import UNASSIGNED, USAGE_INPUTS, USAGE_OUTPUTS
from ecatd.master.mailbox.coe import Coe
from ecatd.master.mailbox.conversation import Conversation
from ecatd.master.mailbox.soe import SoeRefusedError, read_idn

from .scanned import Scanned, SlaveMailbox

_CONFIGURED = 7
_TYPE_BITS = 0x07
_PER_DRIVE = 0x1000
_ENTRIES_MAX = 64
_UNNAMED = {CONTROL: "Master control word", STATUS: "Drive status word"}


class Telegrams(SlaveMailbox):
    """Reads the telegrams of one slave; has the methods of `Assignment`.

    The SII describes the process data of a drive without such lists.
    """

    def __init__(self, item: Scanned, coe: Coe) -> None:
        super().__init__(item, coe)
        self.guessed: set[tuple[int, int]] = set()  # attributes tell all types
        self._known: dict[tuple[int, int], IdnValue] = {}

    def read(self) -> Conversation[Believed]:
        """Reads telegrams, names, types and units, and compares them with other witnesses.

        Raises:
            NoAnswerError: The slave does not answer.
            StateError: Its answers are malformed, or its telegrams cannot be exchanged.
        """
        return self._coe.converse(self._believe)

    def read_pdos(self) -> Conversation[Believed]:
        """The same as `read`."""
        return self.read()

    def _believe(self) -> Conversation[Believed]:
        told = yield from self._told()
        in_sii = {pdo.index: pdo for pdo in (*self._sii.outputs, *self._sii.inputs)}
        for pdo in (*told.outputs, *told.inputs):
            known = in_sii.get(pdo.index)
            if known is not None and other_idns(pdo, known):
                told.changeable.add(pdo.index)
        return believe(self._slave, self._sii, self._settings, told)

    def _told(self) -> Conversation[Reported]:
        told = Reported()
        for drive in range(DRIVES):
            try:
                lists = yield from self._lists(drive)
            except SoeRefusedError:
                break
            if lists is None:
                return self._of_sii()
            mdt, at = lists
            told.outputs += yield from self._telegram(drive, mdt, MDT_LIST, CONTROL, USAGE_OUTPUTS)
            told.inputs += yield from self._telegram(drive, at, AT_LIST, STATUS, USAGE_INPUTS)
        return told if told.outputs or told.inputs else self._of_sii()

    def _of_sii(self) -> Reported:
        """What the EEPROM says; the drive does not say more."""
        outputs, inputs = (
            [replace(pdo) for pdo in pdos if pdo.sync_manager != UNASSIGNED]
            for pdos in (self._sii.outputs, self._sii.inputs)
        )
        return Reported(outputs, inputs, silent=True)

    def _lists(self, drive: int) -> Conversation[tuple[list[int], list[int]] | None]:
        """Reads the IDNs in MDT and AT; None if the drive has standard telegrams.

        Raises:
            SoeRefusedError: There is no such drive, or it has no lists.
        """
        try:
            kind = yield from self._idn(drive, TELEGRAM_TYPE)
        except SoeRefusedError:
            pass  # then the lists count
        else:
            number = int.from_bytes(kind.value, "little") & _TYPE_BITS
            if number != _CONFIGURED:
                return None
        mdt = yield from self._list(drive, MDT_LIST)
        return mdt, (yield from self._list(drive, AT_LIST))

    def _list(self, drive: int, number: int) -> Conversation[list[int]]:
        data = (yield from self._idn(drive, number)).value
        if len(data) % 2 or len(data) > 2 * _ENTRIES_MAX:
            raise StateError(
                f"{self._slave.label}: {idn_text(number)} of drive {drive} has {len(data)} bytes: "
                f"a list of at most {_ENTRIES_MAX} IDNs has two bytes for each"
            )
        return [int.from_bytes(data[at : at + 2], "little") for at in range(0, len(data), 2)]

    def _telegram(
        self, drive: int, listed: list[int], index: int, first: int, usage: int
    ) -> Conversation[list[Pdo]]:
        channels = self._sii.channels(usage)
        name = f"{'MDT' if usage == USAGE_OUTPUTS else 'AT'} {drive + 1}"
        if not channels:
            raise StateError(
                f"{self._slave.label} has the telegram {name}, but its EEPROM has no sync manager "
                "for it"
            )
        entries = []
        for number in listed if first in listed else [first, *listed]:
            entries.append((yield from self._entry(drive, number, name)))
        pdo = Pdo(telegram_index(index, drive), name, channels[0], entries)
        self._take_subindices(pdo, self._sii.outputs + self._sii.inputs)
        return [pdo]

    @staticmethod
    def _take_subindices(pdo: Pdo, described: list[Pdo]) -> None:
        same = (entry for known in described if known.index == pdo.index for entry in known.entries)
        subindices = {entry.index: entry.subindex for entry in same}
        for entry in pdo.entries:
            entry.subindex = subindices.get(entry.index, entry.subindex)

    def _entry(self, drive: int, number: int, telegram: str) -> Conversation[Entry]:
        """Reads what a telegram has of an IDN."""
        try:
            idn = yield from self._idn(drive, number)
        except SoeRefusedError as error:
            entry = self._entry_of_sii(drive, number)
            if entry is None:
                raise StateError(
                    f"{self._slave.label}: {telegram} has {idn_text(number)}, of which the drive "
                    f"does not say how long it is: {error}"
                ) from error
            return entry
        attribute = idn.attribute
        if attribute.is_list or not attribute.size:
            raise StateError(
                f"{self._slave.label}: {telegram} has {idn_text(number)} ({idn.name}), which is a "
                "list, and no list has a fixed length: take it out of the telegram"
            )
        entry = Entry(
            number,
            drive,
            idn.name or _UNNAMED.get(number, idn_text(number)),
            attribute.data_type,
            8 * attribute.size,
        )
        if unit := modelica_unit(idn.unit):
            entry.unit, entry.scale = unit, 10.0**-attribute.decimals
        return entry

    def _entry_of_sii(self, drive: int, number: int) -> Entry | None:
        """What the EEPROM says of an IDN in a telegram of a drive."""
        if number in _UNNAMED:
            return Entry(number, drive, _UNNAMED[number], DataType.UNSIGNED16, 16)
        for pdo in (*self._sii.outputs, *self._sii.inputs):
            if pdo.index // _PER_DRIVE == drive:
                for entry in pdo.entries:
                    if entry.index == number:
                        return replace(entry)
        return None

    def _idn(self, drive: int, number: int) -> Conversation[IdnValue]:
        key = drive, number
        if key not in self._known:
            self._known[key] = yield from read_idn(self._coe.mailbox, drive, number)
        return self._known[key]
