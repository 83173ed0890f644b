"""The IDNs of a drive with SoE that describe its telegrams (IEC 61800-7-204)."""

from __future__ import annotations

import struct
from collections.abc import Iterable

from ecatd.etg.datatypes import is_real, is_signed
from ecatd.etg.idns import ALL_IDNS, AT_LIST, CONTROL, MDT_LIST, STATUS, TELEGRAM_TYPE
from ecatd.etg.pdo import Entry, Pdo

from .soe import READ_ONLY, Idn

_DRIVE, _NUMBER = 12, 0x0FFF  # where a PDO of a drive has its number, and its IDN
_U16, _IDN_LIST = 0x00110000, 0x00550000
_LENGTHS = {16: 1, 32: 2, 64: 3}
_WORD = 16
_SIGNED, _FLOAT = 2, 6
_LENGTH, _KIND = 16, 20
_CONFIGURED = 7


def telegram_idns(pdos: Iterable[Pdo]) -> list[dict[int, Idn]]:
    """Makes the IDNs of each drive that say what its telegrams have, and those in them.

    Args:
        pdos: MDT and AT of each drive, as masters see them: index 0x0018 or 0x0010 + 0x1000 *
            drive.

    Returns:
        The IDNs of each drive; none if lists of IDNs cannot describe these PDOs.
    """
    drives: dict[int, dict[int, Idn]] = {}
    for pdo in pdos:
        number, drive = pdo.index & _NUMBER, pdo.index >> _DRIVE & 7
        first = CONTROL if number == MDT_LIST else STATUS
        whole = all(e.index and e.bit_length in _LENGTHS for e in pdo.entries)
        if number not in (AT_LIST, MDT_LIST) or not whole or not pdo.entries:
            return []
        if pdo.entries[0].index != first or pdo.entries[0].bit_length != _WORD:
            return []
        idns = drives.setdefault(drive, {})
        listed = [entry.index for entry in pdo.entries[1:]]
        name = "Configuration list of the " + ("MDT" if number == MDT_LIST else "AT")
        idns[number] = Idn(name, _IDN_LIST, struct.pack(f"<{len(listed)}H", *listed))
        idns[TELEGRAM_TYPE] = Idn("Telegram type", _U16, struct.pack("<H", _CONFIGURED))
        idns |= {entry.index: _idn(entry, commands=number == MDT_LIST) for entry in pdo.entries}
    for idns in drives.values():
        list_all(idns)
    return [drives.get(number, {}) for number in range(max(drives, default=-1) + 1)]


def list_all(idns: dict[int, Idn]) -> None:
    """Adds the list of all IDNs of a drive, S-0-0017, or brings it up to date."""
    known = sorted({*idns, ALL_IDNS})
    idns[ALL_IDNS] = Idn("List of all IDNs", _IDN_LIST, struct.pack(f"<{len(known)}H", *known))


def _idn(entry: Entry, *, commands: bool) -> Idn:
    kind = _FLOAT if is_real(entry.data_type) else _SIGNED * is_signed(entry.data_type)
    attribute = _LENGTHS[entry.bit_length] << _LENGTH | kind << _KIND
    attribute |= 0 if commands else READ_ONLY
    data = bytes(entry.bit_length // 8)
    return Idn(entry.name, attribute, data, entry.unit, in_mdt=commands)
