"""A generic CiA 402 drive, with the PDOs that masters expect and free PDO mapping."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo

from ..plants.motor import Motor, MotorData
from ..slave.sii import DcMode, Mailbox
from .axis import Switches
from .cia402 import PowerState
from .drive import PARAMETER_FAULT, Drive
from .parameters import Parameter

_I8, _I16, _I32 = DataType.INTEGER8, DataType.INTEGER16, DataType.INTEGER32
_U16, _U32 = DataType.UNSIGNED16, DataType.UNSIGNED32
_MAX_TORQUE = 0x6072
_ENCODER = 65536
_PROBE_FUNCTION = Entry(0x60B8, 0, "Touch probe function", _U16, 16)
_PROBES = (
    Entry(0x60B9, 0, "Touch probe status", _U16, 16),
    Entry(0x60BA, 0, "Touch probe position 1 positive value", _I32, 32),
    Entry(0x60BB, 0, "Touch probe position 1 negative value", _I32, 32),
    Entry(0x60BC, 0, "Touch probe position 2 positive value", _I32, 32),
    Entry(0x60BD, 0, "Touch probe position 2 negative value", _I32, 32),
)
_GAP = Entry(0, 0, "", DataType.PADDING, 8)
_CONTROL = Entry(0x6040, 0, "Controlword", _U16, 16)
_MODE = Entry(0x6060, 0, "Modes of operation", _I8, 8)
_TARGET_POSITION = Entry(0x607A, 0, "Target position", _I32, 32)
_TARGET_VELOCITY = Entry(0x60FF, 0, "Target velocity", _I32, 32)
_TARGET_TORQUE = Entry(0x6071, 0, "Target torque", _I16, 16)
_STATUS = Entry(0x6041, 0, "Statusword", _U16, 16)
_MODE_DISPLAY = Entry(0x6061, 0, "Modes of operation display", _I8, 8)
_POSITION = Entry(0x6064, 0, "Position actual value", _I32, 32)
_VELOCITY = Entry(0x606C, 0, "Velocity actual value", _I32, 32)
_TORQUE = Entry(0x6077, 0, "Torque actual value", _I16, 16)
_ERROR = Entry(0x603F, 0, "Error code", _U16, 16)
_INPUTS = Entry(0x60FD, 0, "Digital inputs", _U32, 32)
_ALL_TARGETS = [_CONTROL, _MODE, _GAP, _TARGET_POSITION, _TARGET_VELOCITY, _TARGET_TORQUE]
_ALL_VALUES = [_STATUS, _MODE_DISPLAY, _GAP, _POSITION, _VELOCITY, _TORQUE, _ERROR, _INPUTS]


class ServoDrive(Drive):
    """A drive with a motor, its limit switches and home switch, and mechanical stops.

    Args:
        travel: Revolutions between each limit switch and the start position; 0: no switches.
        stops: Revolutions between each mechanical stop and the start position; 0: no stops.
        home: Position of the home switch, in revolutions from the start position.
        encoder: Counts per revolution; None: as usual with this drive.
        inertia: Inertia of motor and load in kg m².
        seed: Seed of the noise in the measured current.
    """

    parameters: Sequence[Parameter] = (
        Parameter("travel", "revolutions to each limit switch, 0 for none", 0.0, 0, 10000),
        Parameter("stops", "revolutions to each mechanical stop, 0 for none", 0.0, 0, 10000),
        Parameter("home", "home switch, in revolutions from the start", 0.0, -10000, 10000),
        Parameter("encoder", "counts per revolution", _ENCODER, 100, 16777216),
        Parameter("inertia", "motor and load in kg m²", 2.5e-4, 1e-6, 1),
        Parameter("seed", "seed of the noise of the measured current", 1),
    )
    usual_encoder = _ENCODER
    always_homes = False
    """Whether there is a home switch even without limit switches."""

    def __init__(
        self,
        travel: float = 0.0,
        stops: float = 0.0,
        home: float = 0.0,
        encoder: int | None = None,
        inertia: float = 2.5e-4,
        seed: int = 1,
    ) -> None:
        motor = Motor(MotorData(encoder=encoder or self.usual_encoder, inertia=inertia), seed)
        if stops:
            motor.stops = (-stops * 2 * math.pi, stops * 2 * math.pi)
        low, high = (-travel, travel) if travel else (None, None)
        at = home if travel or self.always_homes else None
        super().__init__(motor, Switches(low, high, at))


class CiA402Drive(ServoDrive):
    """CiA 402 servo drive with a motor.

    0x1600 and 0x1A00 serve all modes and are assigned; 0x1601 to 0x1603 and 0x1A01 to 0x1A03 are
    for cyclic synchronous position, velocity and torque, 0x1604 and 0x1A04 for the touch probes.

    Args:
        forgetful: Whether the drive does not store its maximum torque 0x6072, so that it is 0 at
            power-on. Enabling the drive before a master has written it is then a fault (0x6320).
    """

    vendor = 0x0000FFFF
    product = 0x00000402
    revision = 1
    order = "CiA402"
    name = "CiA 402 servo drive"
    mailbox = Mailbox(coe_details=0x0F)
    variable_assignment = True
    variable_mapping = True
    dc_modes = (
        DcMode("DC", 0x0300, description="Synchronous with SYNC0"),
        DcMode("SM", 0x0000, description="Synchronous with the process data"),
    )
    minimum_cycle_ns = 250_000
    rx_pdos: Sequence[Pdo] = (
        Pdo(0x1600, "All targets", 2, _ALL_TARGETS),
        Pdo(0x1601, "Cyclic position", 0xFF, [_CONTROL, _TARGET_POSITION]),
        Pdo(0x1602, "Cyclic velocity", 0xFF, [_CONTROL, _TARGET_VELOCITY]),
        Pdo(0x1603, "Cyclic torque", 0xFF, [_CONTROL, _TARGET_TORQUE]),
        Pdo(0x1604, "Touch probes", 0xFF, [_PROBE_FUNCTION]),
    )
    tx_pdos: Sequence[Pdo] = (
        Pdo(0x1A00, "All actual values", 3, _ALL_VALUES),
        Pdo(0x1A01, "Position", 0xFF, [_STATUS, _POSITION]),
        Pdo(0x1A02, "Velocity", 0xFF, [_STATUS, _POSITION, _VELOCITY]),
        Pdo(0x1A03, "Torque", 0xFF, [_STATUS, _POSITION, _VELOCITY, _TORQUE]),
        Pdo(0x1A04, "Touch probes", 0xFF, [*_PROBES]),
    )
    parameters = (
        *ServoDrive.parameters,
        Parameter("forgetful", "0x6072 is 0 at power-on; enabling is then a fault", False),
    )
    always_homes = True

    def __init__(self, *, forgetful: bool = False, **parameters: Any) -> None:
        self._forgetful = forgetful
        super().__init__(**parameters)

    def describe(self) -> None:
        """Adds the objects of the drive profile."""
        super().describe()
        if self._forgetful:
            self.dictionary[_MAX_TORQUE, 0].value = 0

    def _watch(self, elapsed: float) -> None:
        super()._watch(elapsed)
        enabled = self.power.state == PowerState.OPERATION_ENABLED
        if self._forgetful and enabled and not self[_MAX_TORQUE, 0]:
            self.fault(PARAMETER_FAULT)
