"""Compares, for `ecatctl config check`, what witnesses say of the process data of slaves."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ecatd.config import Config
from ecatd.config.expected_bus import Difference
from ecatd.config.expected_slave import DifferenceKind
from ecatd.config.resolve.believed import remaining
from ecatd.description.bus import Bus
from ecatd.description.witnesses import (
    COE,
    CONFIGURATION,
    ESI,
    SII,
    SOE,
    Contradiction,
    clash,
    contradiction_text,
    witness_name,
)

if TYPE_CHECKING:
    from ecatd.vendor.esi import EsiDevice


def contradictions(
    wanted: Config, bus: Bus, devices: Mapping[int, EsiDevice], unexpected: Collection[int]
) -> tuple[list[Difference], list[str]]:
    """Finds contradictions between the witnesses of each slave.

    Args:
        wanted: The configuration, about the slaves where they were found.
        bus: The bus.
        devices: Their ESI descriptions, by position.
        unexpected: Positions of slaves that are not the expected ones.

    Returns:
        Those about which the configuration does not decide, and notes about the others.
    """
    from ecatd.vendor.esi.check import described_pdos

    open_, notes = [], []
    for slave in bus.slaves:
        n, settings = slave.position, wanted.settings_of(slave.position)
        if n in unexpected:
            continue
        device = devices.get(n)
        esi = {} if device is None else described_pdos(device, slave)
        for item in remaining(slave, settings, esi):
            text = f"{slave.label}, {contradiction_text(item)}"
            if device is not None and any(pdo.witness == ESI for pdo in item.accounts):
                text += f" ({Path(device.path).name})"
            if item.believed:
                name = witness_name(item.believed)
                notes.append(f"{text}. A start with this file believes {name}")
            else:
                text += f": {_advice(item)}"
                open_.append(
                    Difference(DifferenceKind.CONTRADICTION, (n,), (n,), text, strict=False)
                )
    return open_, notes


def _advice(item: Contradiction) -> str:
    by_witness = {pdo.witness: pdo for pdo in item.accounts}
    esi = by_witness.get(ESI)
    if esi is None:
        return (
            "choose the right one with pdo_source in its [[slave]] table; with --esi, its ESI file "
            "is asked, too"
        )
    for witness in (COE, SOE, SII, CONFIGURATION):
        if witness in by_witness and clash(esi, by_witness[witness]) is None:
            return f'pdo_source = "{witness}" in its [[slave]] table agrees with the ESI file'
    if SOE in by_witness:
        return (
            'write pdo_source = "soe" if the drive is right, or "sii" if its EEPROM is; if neither '
            "is, write the IDNs of its telegrams with [[slave.idn]]"
        )
    return (
        'write pdo_source = "coe" if the slave is right; if the ESI file is right, "configuration" '
        "and its entries in [[slave.pdo]], as `ecatctl config init --esi` does"
    )
