"""An expected slave in messages, and how one that was found differs from it."""

from __future__ import annotations

from ecatd.description.bus import Slave
from ecatd.description.modules import other_modules

from . import Mark, SlaveConfig

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


def identity_difference(wanted: SlaveConfig, slave: Slave) -> tuple[str, str]:
    """Kind of the difference of the identity, and what is there in place of what; or "".

    The second is such as `revision 0x000F0000, not 0x00100000 or newer`.
    """
    if wanted.product is None:
        return "", ""
    if (wanted.vendor, wanted.product) != (slave.vendor, slave.product):
        should = device(wanted.vendor or 0, wanted.product)
        return "other device", f"{device(slave.vendor, slave.product)}, not {should}"
    least = wanted.revision if wanted.revision_min is None else wanted.revision_min
    if least is not None and (
        slave.revision < least or (wanted.revision is not None and slave.revision != least)
    ):
        newer = "" if wanted.revision_min is None else " or newer"
        return "other revision", f"revision 0x{slave.revision:08X}, not 0x{least:08X}{newer}"
    if wanted.serial is not None and wanted.serial != slave.serial:
        return "other serial number", f"serial number {slave.serial}, not {wanted.serial}"
    return "", ""


def difference(wanted: SlaveConfig, slave: Slave) -> tuple[str, str]:
    """Kind and text of the difference between an expected slave and one that was found, or ""."""
    kind, what = identity_difference(wanted, slave)
    if kind == "other device":
        if (slave.vendor, slave.product) in _NOT_WRITTEN:
            return kind, (
                f"{slave.label} should be {label(wanted)}, but its EEPROM does not name a device "
                f"({device(slave.vendor, slave.product)}): put the right slave in, or write its "
                "EEPROM again, from the ESI file of its vendor"
            )
        return kind, (
            f"{slave.label} should be {label(wanted)}, but is another device ({what}): put the "
            "right one in, or correct its [[slave]] table"
        )
    if kind:
        correct = {
            "other revision": "revision in its [[slave]] table (revision_min accepts newer ones)",
            "other serial number": "serial in its [[slave]] table",
        }
        return kind, f"{slave.label} has {what}: put the right one in, or correct {correct[kind]}"
    has_both = wanted.product is not None and wanted.module and slave.modules
    if has_both and (text := other_modules(wanted.modules, slave.modules)):
        return "other modules", f"{slave.label} {text}"
    return "", ""
