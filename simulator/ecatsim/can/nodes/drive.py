"""A CANopen drive (CiA 301, CiA 402) with a motor: the drive of EtherCAT, on another bus."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ecatd.etg.datatypes import DataType

from ...devices.axis import Switches
from ...devices.cia402 import PowerState
from ...devices.drive import Drive
from ...devices.drive_options import DriveOptions
from ...devices.homing import HomingOptions
from ...devices.parameters import Parameter
from ...plants.motor import Motor, MotorData
from ...slave.objects import Access
from ..canopen import CanopenNode

EDS = Path(__file__).parent / "canopen_drive.eds"
"""Its electronic data sheet, for masters."""

_ABORT_OPTION = 0x6007
_OF_ETHERCAT = (0x1C00, 0x1C12, 0x1C13)
_CONTROL = 0x6040
_NO_ACTION, _MALFUNCTION, _DISABLE, _QUICK_STOP = range(4)
_CONNECTION_LOST = 0x8100  # communication error
_QUICK_STOP_WORD = 0x0002
_RECEIVE = (
    ((0x6040, 0), (0x6060, 0)),
    ((0x6040, 0), (0x607A, 0)),
    ((0x6040, 0), (0x60FF, 0)),
    ((0x6040, 0), (0x6071, 0)),
)
_TRANSMIT = (
    (255, ((0x6041, 0), (0x6061, 0))),
    (1, ((0x6041, 0), (0x6064, 0))),
    (1, ((0x6064, 0), (0x606C, 0))),
    (1, ((0x6041, 0), (0x6077, 0))),
)


class _Amplifier(Drive):
    """The drive behind the bus interface; it is on no EtherCAT segment."""

    vendor = 0x0000FFFF
    product = 0x00000402
    revision = 1
    order = "CANopen drive"
    options = DriveOptions(
        homing=HomingOptions((1, 2, 17, 18, 33, 34, 35, 37), {}),
        without=tuple(range(0x60B8, 0x60BE)),
    )

    def __init__(self, motor: Motor, tell: Callable[[int, int], None]) -> None:
        self._tell = tell
        super().__init__(motor, Switches())
        for index in _OF_ETHERCAT:
            self.dictionary.remove(index)

    def describe(self) -> None:
        super().describe()
        self.dictionary.variable(
            _ABORT_OPTION,
            "Abort connection option code",
            DataType.INTEGER16,
            _QUICK_STOP,
            Access.RW,
        )
        entry = self.dictionary[_ABORT_OPTION, 0]
        entry.minimum, entry.maximum = _NO_ACTION, _QUICK_STOP

    def emergency(self, code: int, register: int, data: bytes = b"") -> None:
        del data
        self._tell(code, register)


class CanopenDrive(CanopenNode):
    """CANopen servo drive (CiA 402) with a motor.

    Its objects, modes and motor are those of the EtherCAT drive `CiA402`. When it leaves
    OPERATIONAL (NMT stop, a heartbeat that is missing), it stops as 0x6007 says: 0 not at all, 1
    with a fault, 2 without power, 3 (the default) by the quick stop ramp.

    Args:
        node_id: Its node number.
        encoder: Counts per revolution.
        inertia: Inertia of motor and load in kg m².
        heartbeat_ms: Time between two heartbeats; 0: none.
        seed: Seed of the noise in the measured current.
        bit_rate: Its bit rate; 0: that of the bus.
    """

    parameters = (
        Parameter("node_id", "node number", 1, 1, 127),
        Parameter("encoder", "counts per revolution", 65536, 100, 16777216),
        Parameter("inertia", "motor and load in kg m²", 2.5e-4, 1e-6, 1),
        Parameter("heartbeat_ms", "time between two heartbeats, 0 for none", 100, 0, 65535),
        Parameter("seed", "seed of the noise of the measured current", 1),
    )

    def __init__(
        self,
        node_id: int = 1,
        encoder: int = 65536,
        inertia: float = 2.5e-4,
        heartbeat_ms: int = 100,
        seed: int = 1,
        bit_rate: int = 0,
    ) -> None:
        self.motor = Motor(MotorData(encoder=encoder, inertia=inertia), seed)
        self._drive = _Amplifier(self.motor, self.emergency)
        super().__init__(
            node_id,
            self._drive.dictionary,
            _RECEIVE,
            _TRANSMIT,
            heartbeat_ms=heartbeat_ms,
            name=f"CANopen drive {node_id}",
            bit_rate=bit_rate,
        )

    @property
    def power_state(self) -> PowerState:
        """State of its power stage."""
        return self._drive.power.state

    @property
    def application(self) -> dict[str, str | float]:
        """Its states, and the speed of the motor in rad/s."""
        power = self.power_state.name.lower().replace("_", " ")
        return super().application | {"power": power, "speed": round(self.motor.speed, 3)}

    def work(self, now: float) -> None:
        """Runs the drive and its motor."""
        if not self._drive.sleeps:
            self._drive.run(now)

    def left_operational(self) -> None:
        """Stops as 0x6007 says."""
        drive = self._drive
        drive.wake()
        option = drive[_ABORT_OPTION, 0]
        if option == _MALFUNCTION:
            drive.fault(_CONNECTION_LOST)
        elif option == _DISABLE:
            drive[_CONTROL, 0] = 0
        elif option == _QUICK_STOP:
            drive[_CONTROL, 0] = _QUICK_STOP_WORD

    def reset_application(self) -> None:
        """Begins as after power-on. The motor keeps turning."""
        self._drive.reset()

    def power(self, on: bool) -> None:
        """Switches its power; without it, the motor coasts."""
        if not on:
            self._drive.reset()
        super().power(on)
