"""What differs between CiA 402 drives of different manufacturers."""

from __future__ import annotations

from dataclasses import dataclass, field

from .homing import HomingOptions
from .modes import Mode

STANDARD_MODES = tuple(mode for mode in Mode if mode is not Mode.INTERPOLATED_POSITION)


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveOptions:
    """Options of a simulated drive; the defaults are the standard.

    Attributes:
        modes: Modes of operation that it has, with 0.
        supported_modes: Object 0x6502; None: the modes.
        quick_stop: Values that 0x605A accepts.
        homing: What it can home by.
        speeds_in_rpm: Whether speeds are in revolutions a minute and accelerations in revolutions a
            minute and second, instead of counts.
        home_bit: Bit of the status word that says that the position counts from the reference, or
            None.
        limit_faults: Error codes of the faults that the negative and the positive limit switch are
            outside of homing; None: they hold the axis.
        torque_when_switched_on: Whether the motor is held in SWITCHED ON.
        probes: Number of touch probes.
        probe_index: Whether a touch probe can take the index pulse.
        without: Objects of the drive profile that masters do not find; their defaults count.
    """

    modes: tuple[Mode, ...] = STANDARD_MODES
    supported_modes: int | None = None
    quick_stop: tuple[int, ...] = (0, 1, 2, 3, 5, 6, 7)
    homing: HomingOptions = field(default_factory=HomingOptions)
    speeds_in_rpm: bool = False
    home_bit: int | None = None
    limit_faults: tuple[int, int] | None = None
    torque_when_switched_on: bool = False
    probes: int = 2
    probe_index: bool = True
    without: tuple[int, ...] = ()

    @property
    def mode_bits(self) -> int:
        """Value of object 0x6502."""
        own = sum(1 << (mode - 1) for mode in self.modes if mode)
        return own if self.supported_modes is None else self.supported_modes
