"""A servo drive with SoE: telegrams of IDNs, and a motor for each axis (IEC 61800-7-204).

Units: rpm with four decimals, increments of the encoder, and 1/10 % of the rated torque.
"""

from __future__ import annotations

import math
import struct

from ecatd.etg.al import AlState
from ecatd.etg.datatypes import DataType
from ecatd.etg.idns import AT_LIST, CONTROL, MDT_LIST, STATUS, TELEGRAM_TYPE, idn_text
from ecatd.etg.pdo import Entry, Pdo

from ..plants.motor import Control, Motor, MotorData
from ..slave.device import Device
from ..slave.objects import Access, ObjectCode, Variable
from ..slave.sii import DcMode, Mailbox
from ..slave.soe import Idn
from ..slave.state_machine import AlCode, RefusedError
from ..slave.telegrams import list_all, telegram_idns
from .parameters import Parameter, revision_of

_U16, _I16, _I32 = DataType.UNSIGNED16, DataType.INTEGER16, DataType.INTEGER32
_MODE, _LIMIT, _RESOLUTION = 32, 91, 79
_VELOCITY_COMMAND, _POSITION_COMMAND, _TORQUE_COMMAND = 36, 47, 80
_VELOCITY, _POSITION, _TORQUE = 40, 51, 84
_SPEEDS = (_VELOCITY_COMMAND, _VELOCITY, _LIMIT)
_COMMANDS = {
    CONTROL: ("Master control word", _U16, ""),
    _VELOCITY_COMMAND: ("Velocity command value", _I32, "rpm"),
    _POSITION_COMMAND: ("Position command value", _I32, "inc"),
    _TORQUE_COMMAND: ("Torque command value", _I16, "%"),
}
_VALUES = {
    STATUS: ("Drive status word", _U16, ""),
    _VELOCITY: ("Velocity feedback value 1", _I32, "rpm"),
    _POSITION: ("Position feedback value 1", _I32, "inc"),
    _TORQUE: ("Torque feedback value", _I16, "%"),
}
_MODES = {1: _TORQUE_COMMAND, 2: _VELOCITY_COMMAND, 3: _POSITION_COMMAND}
_PER_AXIS = 0x1000  # from the telegram of one axis to that of the next
_DECIMALS, _SPEED_FACTOR = 4, 10_000
_PROTECTED = 6 << 28  # in SAFEOP and OP
_U16_VALUE, _U32_VALUE, _I32_VALUE = 0x00110000, 0x00120000, 0x00220000
_RUN = 0xE000  # control word: drive on, enabled, and no halt
_POWERED, _IN_TORQUE, _FOLLOWS = 0x8000, 0xC000, 0x0008
_RPM = 2 * math.pi / 60


class _Axis:
    """One axis: its motor, and the entries of its telegrams.

    Args:
        drive: The device.
        number: Number of the axis.
        motor: The motor.
    """

    def __init__(self, drive: Device, number: int, motor: Motor) -> None:
        self._drive = drive
        self._number = number
        self.motor = motor

    def step(self, now: float, mode: int, limit: float) -> None:
        """Moves the motor, and sets the feedback values."""
        drive, number, motor = self._drive, self._number, self.motor
        runs = drive[CONTROL, number] & _RUN == _RUN
        speed = drive[_VELOCITY_COMMAND, number] / _SPEED_FACTOR
        motor.control = Control.OFF
        if runs and mode == 2:
            motor.control = Control.VELOCITY
            motor.target = max(-limit, min(limit, speed)) * _RPM
        elif runs and mode == 3:
            motor.control = Control.POSITION
            motor.target = drive[_POSITION_COMMAND, number] / motor.data.encoder * 2 * math.pi
        elif runs:
            motor.control = Control.CURRENT
            motor.target = drive[_TORQUE_COMMAND, number] / 1000 * motor.data.rated_torque
        motor.step(now)
        drive[STATUS, number] = _IN_TORQUE | _FOLLOWS if runs else _POWERED
        drive[_VELOCITY, number] = round(motor.speed / _RPM * _SPEED_FACTOR)
        turns = motor.position / (2 * math.pi)
        drive[_POSITION, number] = _wrapped(round(turns * motor.data.encoder))
        rated = motor.measured_current / motor.data.rated_current
        drive[_TORQUE, number] = max(-0x8000, min(0x7FFF, round(1000 * rated)))


class SoeDrive(Device):
    """Servo drive with SoE (SERCOS), with a motor for each axis.

    Its telegrams can be changed in PREOP, with S-0-0016 and S-0-0024. S-0-0032 is the mode of
    operation: 1 torque, 2 velocity, 3 position; its command value must be in the MDT.

    Args:
        axes: Number of axes.
        encoder: Increments per revolution.
        inertia: Inertia of motor and load in kg m².
        seed: Seed of the noise in the measured current.
    """

    vendor = 0x0000FFFF
    product = 0x00005000
    revision = 1
    order = "SoeDrive"
    name = "SoE servo drive"
    mailbox = Mailbox(receive_size=256, send=0x1100, send_size=256, protocols=0x10, coe_details=0)
    variable_mapping = True
    dc_modes = (DcMode("DC", 0x0300, description="Synchronous with SYNC0"),)
    minimum_cycle_ns = 250_000
    parameters = (
        Parameter("axes", "number of axes", 1, 1, 4),
        Parameter("encoder", "increments per revolution", 1 << 20, 100, 1 << 24),
        Parameter("inertia", "motor and load in kg m²", 2.5e-4, 1e-6, 1),
        Parameter("seed", "seed of the noise of the measured current", 1),
    )

    def __init__(
        self, axes: int = 1, encoder: int = 1 << 20, inertia: float = 2.5e-4, seed: int = 1
    ) -> None:
        self.revision = revision_of(self.parameters[:1], axes)
        data = MotorData(encoder=encoder, inertia=inertia)
        self.axes = [_Axis(self, number, Motor(data, seed + number)) for number in range(axes)]
        self.rx_pdos = tuple(
            _telegram(n, MDT_LIST, (CONTROL, _VELOCITY_COMMAND)) for n in range(axes)
        )
        self.tx_pdos = tuple(_telegram(n, AT_LIST, (STATUS, _POSITION)) for n in range(axes))
        self.idns = telegram_idns((*self.rx_pdos, *self.tx_pdos))
        for number in range(axes):
            self._describe_idns(number, encoder)
        self._limits = [math.inf] * axes
        self._modes = [2] * axes
        super().__init__()

    def _describe_idns(self, number: int, encoder: int) -> None:
        known = telegram_idns(
            [_telegram(0, MDT_LIST, tuple(_COMMANDS)), _telegram(0, AT_LIST, tuple(_VALUES))]
        )[0]
        idns = self.idns[number]
        for idn in (*_COMMANDS, *_VALUES):
            idns.setdefault(idn, known[idn])
            if idn in _SPEEDS:
                idns[idn].attribute |= _DECIMALS << 24
            if idn in (_TORQUE_COMMAND, _TORQUE):
                idns[idn].attribute |= 1 << 24
        idns[TELEGRAM_TYPE].attribute |= _PROTECTED
        for idn in (AT_LIST, MDT_LIST):
            idns[idn].attribute |= _PROTECTED
        idns[_MODE] = Idn(
            "Primary operation mode", _U16_VALUE | _PROTECTED, struct.pack("<H", 2), "", 1, 3
        )
        idns[_RESOLUTION] = Idn(
            "Rotational position resolution", _U32_VALUE, struct.pack("<I", encoder), "inc"
        )
        most = 6000 * _SPEED_FACTOR
        limit = _I32_VALUE | _DECIMALS << 24
        idns[_LIMIT] = Idn(
            "Bipolar velocity limit value", limit, struct.pack("<i", most), "rpm", 0, most
        )
        list_all(idns)

    def describe(self) -> None:
        """Adds what the telegrams may have, beside what they have at first."""
        for known, access in ((_COMMANDS, Access.RX_PDO), (_VALUES, Access.TX_PDO)):
            for idn, (name, kind, _) in known.items():
                if idn not in self.dictionary:
                    self.dictionary.record(idn, name, [], code=ObjectCode.RECORD)
                    del self.dictionary.object(idn).entries[0]  # of CoE; here it is drive 0
                entries = self.dictionary.object(idn).entries
                for number in range(len(self.axes)):
                    entries.setdefault(
                        number, Variable(idn, number, name, kind, access=Access.RO | access)
                    )

    def step(self, now: float) -> None:
        """Moves the motors."""
        for number, axis in enumerate(self.axes):
            exchanged = self.machine.state in (AlState.SAFEOP, AlState.OP)
            for command in _COMMANDS:
                idn, variable = self.idns[number][command], self.dictionary[command, number]
                if exchanged and idn.in_mdt:
                    idn.value = variable.encode()
                else:
                    variable.value = variable.decode(idn.value)
            axis.step(now, self._modes[number], self._limits[number])
            for value in _VALUES:
                self.idns[number][value].value = self.dictionary[value, number].encode()

    def _check(self, old: AlState, new: AlState) -> None:
        if new == AlState.SAFEOP and old == AlState.PREOP:
            for number in range(len(self.axes)):
                self._take_telegrams(number)
        super()._check(old, new)

    def _take_telegrams(self, number: int) -> None:
        """Takes the telegrams over that the master has written.

        Raises:
            RefusedError: They have an IDN that the drive cannot exchange, or lack a command value.
        """
        idns = self.idns[number]
        if int.from_bytes(idns[TELEGRAM_TYPE].value, "little") & 7 != 7:
            raise RefusedError(AlCode.OUTPUT_MAPPING)
        self._modes[number] = int.from_bytes(idns[_MODE].value, "little")
        self._limits[number] = int.from_bytes(idns[_LIMIT].value, "little") / _SPEED_FACTOR
        for list_, first, offered, code in (
            (MDT_LIST, CONTROL, _COMMANDS, AlCode.OUTPUT_MAPPING),
            (AT_LIST, STATUS, _VALUES, AlCode.INPUT_MAPPING),
        ):
            data = idns[list_].value
            listed = list(struct.unpack(f"<{len(data) // 2}H", data[: len(data) // 2 * 2]))
            if any(idn not in offered or idn == first for idn in listed):
                raise RefusedError(code)
            if list_ == MDT_LIST:
                if _MODES[self._modes[number]] not in listed:
                    raise RefusedError(code)
                for command in _COMMANDS:
                    idns[command].in_mdt = command in (first, *listed)
            entries = _telegram(number, list_, (first, *listed)).entries
            mapping = self.dictionary.object(list_ + _PER_AXIS * number).entries
            for place, entry in enumerate(entries, 1):
                mapping[place].value = entry.index << 16 | number << 8 | entry.bit_length
            mapping[0].value = len(entries)


def _telegram(number: int, list_: int, idns: tuple[int, ...]) -> Pdo:
    """Makes a telegram of an axis."""
    offered = _COMMANDS if list_ == MDT_LIST else _VALUES
    entries = []
    for idn in idns:
        name, kind, unit = offered[idn]
        bits = 32 if kind == _I32 else 16
        entries.append(Entry(idn, number, name or idn_text(idn), kind, bits, unit))
    name = f"{'MDT' if list_ == MDT_LIST else 'AT'} {number + 1}"
    return Pdo(list_ + _PER_AXIS * number, name, 2 if list_ == MDT_LIST else 3, entries)


def _wrapped(value: int) -> int:
    """Returns a value as a signed 32-bit counter shows it."""
    return (value + (1 << 31)) % (1 << 32) - (1 << 31)
