"""Compares the PDOs of a slave and of a configuration with what an ESI file says (ETG.2000)."""

from __future__ import annotations

from collections.abc import Iterator

from ecatd.config.slave_settings import SlaveConfig
from ecatd.description.bus import Slave
from ecatd.description.witnesses import other_idns
from ecatd.etg.idns import TELEGRAM_LISTS, telegram_index
from ecatd.etg.pdo import Pdo

from .device import EsiDevice, EsiPdo
from .modules import plug

_MAPS = 0x08  # bit of the CoE details: a master can map other entries


def described_pdos(device: EsiDevice, slave: Slave) -> dict[int, tuple[Pdo, bool]]:
    """Returns the PDOs of a slave as its ESI file describes them, for `believed.remaining`.

    PDOs without entries, and those that a start-up command of the file maps, are left out.

    Returns:
        By index: the PDO, and whether a master can map other entries.
    """
    if device.slots:
        device = plug(device, [module.ident for module in slave.modules])
    mapped = {command.index for command in device.commands}
    mapped |= {telegram_index(c.idn, c.drive) for c in device.idns if c.idn in TELEGRAM_LISTS}
    maps = bool(device.coe_details & _MAPS) and slave.coe
    telegrams = (*slave.outputs, *slave.inputs) if slave.soe and not slave.coe else ()
    told = {pdo.index: pdo for pdo in telegrams}

    def changeable(pdo: EsiPdo) -> bool:
        if pdo.index in told:
            return other_idns(told[pdo.index], pdo)
        return maps and not pdo.fixed

    return {
        pdo.index: (pdo, changeable(pdo))
        for pdo in (*device.outputs, *device.inputs)
        if pdo.entries and pdo.index not in mapped
    }


def pdo_problems(settings: SlaveConfig, device: EsiDevice) -> Iterator[str]:
    """Finds what is wrong with `pdos` and `[[slave.pdo]]` of a slave.

    Yields:
        Sentences without a subject, such as `lacks PDO 0x1600, which is mandatory: …`.
    """
    if device.slots:  # modules bring PDOs of their own
        device = plug(device, [module.ident for module in settings.modules])
    offered: dict[int, EsiPdo] = {pdo.index: pdo for pdo in (*device.outputs, *device.inputs)}
    for own in settings.mapped:
        pdo = offered.get(own.index)
        if pdo is None or not pdo.fixed:
            continue
        wanted = [(*entry.address, entry.bits) for entry in own.entries]
        if wanted != [(entry.index, entry.subindex, entry.bit_length) for entry in pdo.entries]:
            yield (
                f"maps entries into PDO 0x{own.index:04X}, which is fixed: remove that "
                "[[slave.pdo]], or choose another PDO"
            )
    if settings.pdos is None:
        return
    assigned = [offered[index] for index in settings.pdos if index in offered]
    if settings.module or not device.slots:
        for index in settings.pdos:
            if index not in offered:
                all_ = ", ".join(f"0x{known:04X}" for known in offered) or "none"
                yield f"has PDO 0x{index:04X}, which the device does not offer: it offers {all_}"
    for pdo in offered.values():
        if pdo.mandatory and pdo not in assigned and not pdo.is_excluded(assigned):
            yield f"lacks PDO 0x{pdo.index:04X}, which is mandatory: add it to pdos"
    seen: set[frozenset[int]] = set()
    for pdo in assigned:
        for index in pdo.excludes:
            pair = frozenset((pdo.index, index))
            if index in settings.pdos and index != pdo.index and pair not in seen:
                seen.add(pair)
                yield (
                    f"has PDO 0x{pdo.index:04X} together with 0x{index:04X}, which exclude each "
                    "other: remove one of them from pdos"
                )
