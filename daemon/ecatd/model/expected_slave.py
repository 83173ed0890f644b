"""An expected slave in messages, and how one that was found differs from it."""

from __future__ import annotations

from .bus import Slave
from .config import Mark, SlaveConfig
from .modules import module_differences

_NOT_WRITTEN = ((0, 0), (0xFFFFFFFF, 0xFFFFFFFF))
"""Vendor ID and product code of an EEPROM that was never written."""


def label(wanted: SlaveConfig) -> str:
    """An expected slave as messages name it: `infeed (EL1018)`."""
    if wanted.name:
        return f"{wanted.name} ({wanted.type})" if wanted.type else wanted.name
    if wanted.product is not None:
        return wanted.type or device(wanted.vendor or 0, wanted.product)
    return "a slave" if wanted.mark is None else f"the slave with {wanted.mark}"


def has_mark(slave: Slave, mark: Mark) -> bool:
    """Whether a slave has a station alias, or an identification."""
    told = slave.identification if mark.kind == "identification" else slave.alias
    return told == mark.value


def device(vendor: int, product: int) -> str:
    """An identity in messages."""
    return f"vendor 0x{vendor:08X}, product 0x{product:08X}"


def difference(wanted: SlaveConfig, slave: Slave) -> tuple[str, str]:
    """Kind and text of the difference between an expected slave and one that was found, or ""."""
    if wanted.product is None:
        return "", ""
    if (wanted.vendor, wanted.product) != (slave.vendor, slave.product):
        if (slave.vendor, slave.product) in _NOT_WRITTEN:
            return (
                "other device",
                f"{slave.label} should be {label(wanted)}, but its EEPROM does not name a device "
                f"({device(slave.vendor, slave.product)}): put the right slave in, or write its "
                "EEPROM again, from the ESI file of its vendor",
            )
        return (
            "other device",
            f"{slave.label} should be {label(wanted)}, but is another device "
            f"({device(slave.vendor, slave.product)}, not "
            f"{device(wanted.vendor or 0, wanted.product)}): put the right one in, or correct its "
            "[[slave]] table",
        )
    least = wanted.revision if wanted.revision_min is None else wanted.revision_min
    if least is not None and (
        slave.revision < least or (wanted.revision is not None and slave.revision != least)
    ):
        newer = "" if wanted.revision_min is None else " or newer"
        return (
            "other revision",
            f"{slave.label} has revision 0x{slave.revision:08X}, not 0x{least:08X}{newer}: put the "
            "right one in, or correct revision in its [[slave]] table (revision_min accepts newer "
            "ones)",
        )
    if wanted.serial is not None and wanted.serial != slave.serial:
        return (
            "other serial number",
            f"{slave.label} has serial number {slave.serial}, not {wanted.serial}: put the right "
            "one in, or correct serial in its [[slave]] table",
        )
    if wanted.module and slave.modules:
        text = module_differences(wanted.modules, slave.modules)
        if text:
            return (
                "other modules",
                f"{slave.label} has other modules: {text}; put the right ones in, or correct its "
                "[[slave.module]] tables",
            )
    return "", ""
