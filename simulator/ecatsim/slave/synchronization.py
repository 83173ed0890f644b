"""Synchronisation of a device: SYNC signals and the objects 0x1C32 and 0x1C33 (ETG.1020)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import IntEnum

from ecatd.etg import error_codes
from ecatd.etg.datatypes import DataType
from ecatd.etg.error_codes import abort_error

from .objects import Access, Dictionary, Value, Variable
from .sii import DcMode
from .state_machine import AlCode, RefusedError

_STRUCTURE = 0x0029
_PDI_CONFIGURATION, _SYNC0_TO_DEVICE = 0x0151, 0x08
_ACTIVATION, _CYCLE_TIME = 0x0981, 0x09A0
_RUN, _SYNC0, _SYNC1 = 0x01, 0x02, 0x04

Read = Callable[[int, int], int]
"""A function that reads a register of the slave: address and number of bytes."""


class SyncType(IntEnum):
    """Synchronisation type, subindex 1."""

    FREE_RUN = 0x00
    SM = 0x01  # with the sync manager of the same direction
    SYNC0 = 0x02
    SYNC1 = 0x03
    SM2 = 0x22  # inputs, with the sync manager of the outputs


class Synchronization:
    """The use of SYNC0 and SYNC1 by a device.

    Args:
        modes: The supported modes; without any, the device ignores the registers of the SYNC unit.
        minimum_cycle_ns: Shortest cycle time in ns that it accepts; 0 for any.

    Attributes:
        is_watched: Whether the device runs with SYNC0 and gets events for its pulses.
    """

    def __init__(self, modes: Sequence[DcMode], minimum_cycle_ns: int) -> None:
        self._modes = modes
        self._minimum_ns = minimum_cycle_ns
        self._activation = {mode.assign_activate >> 8 & 0x07: mode for mode in modes}
        self._types: list[Variable] = []
        self.stop()

    def add_objects(self, objects: Dictionary, *, outputs: bool) -> None:
        """Adds the objects 0x1C32 and 0x1C33.

        Args:
            objects: The dictionary.
            outputs: Whether the device has outputs; they then synchronise its inputs.
        """
        self._add(objects, 0x1C32, "SM output parameter", SyncType.SM)
        self._add(objects, 0x1C33, "SM input parameter", SyncType.SM2 if outputs else SyncType.SM)

    def stop(self) -> None:
        """Ignores SYNC signals from now on, as below SAFEOP."""
        self._active = self._cycle_ns = 0
        self.is_watched = False

    def start(self, read: Read) -> None:
        """Checks the settings of the master on the way to SAFEOP, and uses them.

        Raises:
            RefusedError: The device does not support the settings.
        """
        self.stop()
        if not self._modes:
            return
        active = read(_ACTIVATION, 1) & (_RUN | _SYNC0 | _SYNC1)
        cycle_ns = read(_CYCLE_TIME, 4)
        wanted = {int(entry.value) for entry in self._types} & {SyncType.SYNC0, SyncType.SYNC1}
        if active and active not in self._activation:
            raise RefusedError(AlCode.DC_SETTINGS)
        if wanted and not active & _RUN:
            raise RefusedError(AlCode.DC_SETTINGS)
        if active & _SYNC0:
            fixed = self._activation[active].sync0_cycle_ns
            if cycle_ns == 0 or (fixed and cycle_ns != fixed):
                raise RefusedError(AlCode.DC_CYCLE_TIME)
            if cycle_ns < self._minimum_ns:
                raise RefusedError(AlCode.SYNC0_CYCLE_TIME)
        self._active, self._cycle_ns = active, cycle_ns
        self.is_watched = bool(active & _SYNC0 and read(_PDI_CONFIGURATION, 1) & _SYNC0_TO_DEVICE)

    def is_lost(self, read: Read) -> bool:
        """Whether the SYNC0 that the device uses has been switched off."""
        return self.is_watched and read(_ACTIVATION, 1) & (_RUN | _SYNC0) != _RUN | _SYNC0

    # --- objects -------------------------------------------------------------------------------

    def _add(self, objects: Dictionary, index: int, name: str, type_: SyncType) -> None:
        u16, u32, configurable = (
            DataType.UNSIGNED16,
            DataType.UNSIGNED32,
            Access.READ | Access.WRITE_PREOP,
        )
        supported = 0x03  # free run, with the sync manager
        for active in self._activation:
            supported |= (0x04 if active & _SYNC0 else 0) | (0x08 if active & _SYNC1 else 0)
        entries = [
            Variable(index, 1, "Synchronization type", u16, 0, configurable, type_),
            Variable(index, 2, "Cycle time", u32, 0, configurable),
            Variable(index, 3, "Shift time", u32, 0, configurable),
            Variable(index, 4, "Synchronization types supported", u16, value=supported),
            Variable(index, 5, "Minimum cycle time", u32, value=self._minimum_ns),
            Variable(index, 6, "Calc and copy time", u32),
            Variable(index, 9, "Delay time", u32),
            Variable(index, 10, "Sync0 cycle time", u32, on_read=lambda: self._cycle_ns),
            Variable(index, 11, "SM-event missed", u16),
            Variable(index, 12, "Cycle time too small", u16),
            Variable(index, 32, "Sync error", DataType.BOOLEAN),
        ]
        kind, cycle = entries[:2]
        kind.on_read = lambda: self._type(kind)
        kind.on_write = lambda value: self._check_type(value, type_, supported)
        cycle.on_read = lambda: self._cycle_ns or cycle.value
        self._types.append(kind)
        objects.record(index, name, entries, type=_STRUCTURE)

    def _type(self, entry: Variable) -> Value:
        """Returns the type in use: that of the running SYNC unit, else that of the master."""
        if self._active & _SYNC1:
            return SyncType.SYNC1
        return SyncType.SYNC0 if self._active & _SYNC0 else entry.value

    @staticmethod
    def _check_type(value: Value, usual: SyncType, supported: int) -> None:
        allowed = {SyncType.FREE_RUN, SyncType.SM, usual}
        allowed |= {SyncType.SYNC0} if supported & 0x04 else set()
        allowed |= {SyncType.SYNC1} if supported & 0x08 else set()
        if value not in allowed:
            raise abort_error(error_codes.VALUE_RANGE)
