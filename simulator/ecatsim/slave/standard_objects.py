"""Adds the objects that every device has: identity and types of sync managers."""

from __future__ import annotations

from collections.abc import Sequence

from ecatd.etg.datatypes import DataType

from .objects import Dictionary, Variable
from .sii import SyncManager

_IDENTITY_STRUCTURE = 0x0023


def add_identity(
    objects: Dictionary, device_type: int, name: str, identity: tuple[int, int, int, int]
) -> None:
    """Adds the objects 0x1000, 0x1001, 0x1008 to 0x100A and 0x1018.

    Args:
        objects: The dictionary.
        device_type: Value of object 0x1000, the profile of the device.
        name: Name of the device.
        identity: Vendor, product, revision and serial number.
    """
    text, u32 = DataType.VISIBLE_STRING, DataType.UNSIGNED32
    objects.variable(0x1000, "Device type", u32, device_type)
    objects.variable(0x1001, "Error register", DataType.UNSIGNED8)
    objects.variable(0x1008, "Device name", text, name or " ")
    objects.variable(0x1009, "Hardware version", text, "00")
    objects.variable(0x100A, "Software version", text, "01")
    names = ("Vendor ID", "Product code", "Revision", "Serial number")
    members = [
        Variable(0x1018, i, names[i - 1], u32, value=value) for i, value in enumerate(identity, 1)
    ]
    objects.record(0x1018, "Identity", members, type=_IDENTITY_STRUCTURE)


def add_sync_managers(objects: Dictionary, sync_managers: Sequence[SyncManager]) -> None:
    """Adds object 0x1C00, the purposes of the sync managers."""
    purposes = [int(sm.type) for sm in sync_managers]
    objects.array(0x1C00, "Sync manager type", DataType.UNSIGNED8, purposes)
