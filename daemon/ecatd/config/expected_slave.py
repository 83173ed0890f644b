"""An expected slave in messages, and how one that was found differs from it."""

from __future__ import annotations

from enum import StrEnum

from ecatd.description.bus import Slave
from ecatd.description.modules import other_modules

from . import Mark, SlaveConfig

_NOT_WRITTEN = ((0, 0), (0xFFFFFFFF, 0xFFFFFFFF))
"""Vendor ID and product code of an EEPROM that was never written."""


class DifferenceKind(StrEnum):
    """The kinds of differences between an expected bus and one that was found."""

    NONE = ""
    MISSING = "missing"
    EXTRA = "extra"
    WRONG_PLACE = "wrong place"
    OTHER_DEVICE = "other device"
    OTHER_REVISION = "other revision"
    OTHER_SERIAL = "other serial number"
    OTHER_ALIAS = "other station alias"
    OTHER_IDENTIFICATION = "other identification"
    OTHER_MODULES = "other modules"
    OTHER_PDOS = "other PDOs"
    OTHER_OBJECTS = "other objects"
    FORBIDDEN_PDOS = "forbidden PDOs"
    FORBIDDEN_MODULES = "forbidden modules"
    CONTRADICTION = "contradicting witnesses"

    @property
    def is_other(self) -> bool:
        """Whether a slave is there, but differs from the expected one."""
        return self not in (
            DifferenceKind.NONE,
            DifferenceKind.MISSING,
            DifferenceKind.EXTRA,
            DifferenceKind.WRONG_PLACE,
        )


def label(wanted: SlaveConfig) -> str:
    """An expected slave as messages name it: `infeed (EL1018)`."""
    if wanted.name:
        return f"{wanted.name} ({wanted.type})" if wanted.type else wanted.name
    if wanted.product is not None:
        return wanted.type or device(wanted.vendor or 0, wanted.product)
    return "a slave" if wanted.mark is None else f"the slave with {wanted.mark}"


def has_mark(slave: Slave, mark: Mark) -> bool:
    """Whether a slave has a station alias, or an identification."""
    value = slave.identification if mark.kind == "identification" else slave.alias
    return value == mark.value


def device(vendor: int, product: int) -> str:
    """An identity in messages."""
    return f"vendor 0x{vendor:08X}, product 0x{product:08X}"


def identity_difference(wanted: SlaveConfig, slave: Slave) -> tuple[DifferenceKind, str]:
    """Kind of the difference of the identity, and what is there in place of what.

    The second is such as `revision 0x000F0000, not 0x00100000 or newer`.
    """
    if wanted.product is None:
        return DifferenceKind.NONE, ""
    if (wanted.vendor, wanted.product) != (slave.vendor, slave.product):
        should = device(wanted.vendor or 0, wanted.product)
        return DifferenceKind.OTHER_DEVICE, f"{device(slave.vendor, slave.product)}, not {should}"
    least = wanted.revision if wanted.revision_min is None else wanted.revision_min
    if least is not None and (
        slave.revision < least or (wanted.revision is not None and slave.revision != least)
    ):
        newer = "" if wanted.revision_min is None else " or newer"
        return (
            DifferenceKind.OTHER_REVISION,
            f"revision 0x{slave.revision:08X}, not 0x{least:08X}{newer}",
        )
    if wanted.serial is not None and wanted.serial != slave.serial:
        return DifferenceKind.OTHER_SERIAL, f"serial number {slave.serial}, not {wanted.serial}"
    return DifferenceKind.NONE, ""


def difference(wanted: SlaveConfig, slave: Slave) -> tuple[DifferenceKind, str]:
    """Kind and text of the difference between an expected slave and one that was found."""
    kind, what = identity_difference(wanted, slave)
    if kind == DifferenceKind.OTHER_DEVICE:
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
        correct = "serial in its [[slave]] table"
        if kind == DifferenceKind.OTHER_REVISION:
            correct = "revision in its [[slave]] table (revision_min accepts newer ones)"
        return kind, f"{slave.label} has {what}: put the right one in, or correct {correct}"
    has_both = wanted.product is not None and wanted.module and slave.modules
    if has_both and (text := other_modules(wanted.modules, slave.modules)):
        return DifferenceKind.OTHER_MODULES, f"{slave.label} {text}"
    return DifferenceKind.NONE, ""
