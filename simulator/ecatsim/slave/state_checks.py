"""The checks of a slave before it goes to a higher state (ETG.1000.6, ETG.1020)."""

from __future__ import annotations

from ecatd.etg.al import AlState

from ..esc import Segment
from . import sync_managers
from .device_type import DeviceType
from .process_data import ProcessData
from .sii import Mailbox
from .state_machine import AlCode, RefusedError

_EEPROM_CONFIGURATION, _EEPROM_OFFERED = 0x0500, 0x01
_EEPROM_STATUS, _EEPROM_LOAD_ERRORS = 0x0502, 0x1800  # checksum error, not loaded


class StateChecks:
    """Checks the registers of the slave controller and the state of one device.

    Args:
        device: The device.
        process_data: Its process data.
        segment: The segment.
        position: Position of the device in the segment.
    """

    def __init__(
        self, device: DeviceType, process_data: ProcessData, segment: Segment, position: int
    ) -> None:
        self._device = device
        self._process_data = process_data
        self._segment = segment
        self._position = position

    def check(self, new: AlState) -> None:
        """Makes the checks that the standard requires before a state.

        Raises:
            RefusedError: A setting of the master is wrong, or the device cannot work.
        """
        if new in (AlState.BOOT, AlState.PREOP) and self._device.mailbox:
            self._check_start(new)
        if new == AlState.SAFEOP:
            self._check_process_data()
        if new in (AlState.SAFEOP, AlState.OP):
            self._process_data.check(self._segment, self._position)
        if new == AlState.SAFEOP and self._device.longest_watchdog is not None:
            sync_managers.check_watchdog(
                self._segment,
                self._position,
                self._process_data.settings,
                self._device.longest_watchdog,
            )

    def _check_start(self, new: AlState) -> None:
        device = self._device
        if self._read(_EEPROM_STATUS) & _EEPROM_LOAD_ERRORS:
            raise RefusedError(AlCode.EEPROM_ERROR)
        if new == AlState.BOOT and device.bootstrap:
            self._check_mailbox(device.bootstrap, AlCode.BOOT_MAILBOX)
        elif device.mailbox:
            if not device.firmware_valid:
                raise RefusedError(AlCode.NO_FIRMWARE)
            if device.needs_eeprom and not self._read(_EEPROM_CONFIGURATION) & _EEPROM_OFFERED:
                raise RefusedError(AlCode.EEPROM_NO_ACCESS)
            self._check_mailbox(device.mailbox, AlCode.MAILBOX)

    def _check_mailbox(self, mailbox: Mailbox, code: AlCode) -> None:
        sync_managers.check_mailbox(self._segment, self._position, mailbox, code)

    def _check_process_data(self) -> None:
        self._process_data.rebuild()
        if self._device.mailbox:
            sync_managers.check_unused(
                self._segment,
                self._position,
                len(self._process_data.settings),
                self._device.chip.sync_managers,
            )

    def _read(self, register: int) -> int:
        return int.from_bytes(self._segment.read(self._position, register, 2), "little")
