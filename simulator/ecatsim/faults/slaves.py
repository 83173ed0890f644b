"""Faults of slaves. The simulation loop carries them out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from ecatd.base.addresses import parse_address
from ecatd.base.errors import StateError, UsageError
from ecatd.etg.al import AlState

from ..parameters import Is
from ..slave.mailbox import MailboxFault, MailboxMode
from . import named_devices
from .fault import SlaveFault
from .target import Target

_MAX_16 = 0xFFFF
_CHECKSUM = 14  # byte of the checksum in the SII image
_HEADER = 128  # bytes of an SII image before its categories

Port = Annotated[
    int,
    Is("port at the slave's end of the cable; 0 leads to the master", minimum=0, maximum=3),
]


@dataclass(frozen=True)
class BreakLink(SlaveFault):
    """A cable breaks: frames turn round at both ends and do not reach the slaves behind it."""

    kind: ClassVar[str] = "break-link"
    port: Port = 0

    def strike(self, target: Target) -> None:
        """Breaks the link."""
        target.segment.break_link(self.slave, self.port, True)


@dataclass(frozen=True)
class HealLink(SlaveFault):
    """A broken cable is whole again; slaves behind it have kept their state and address."""

    kind: ClassVar[str] = "heal-link"
    port: Port = 0

    def strike(self, target: Target) -> None:
        """Heals the link."""
        target.segment.break_link(self.slave, self.port, False)


@dataclass(frozen=True)
class PowerOff(SlaveFault):
    """A slave loses its power, and with it the links at all ports, its state and its address."""

    kind: ClassVar[str] = "power-off"

    def strike(self, target: Target) -> None:
        """Switches the power off."""
        target.power(self.slave, False)


@dataclass(frozen=True)
class PowerOn(SlaveFault):
    """A slave gets its power back and starts in INIT, with station address 0."""

    kind: ClassVar[str] = "power-on"

    def strike(self, target: Target) -> None:
        """Switches the power on."""
        target.power(self.slave, True)


@dataclass(frozen=True)
class Swap(SlaveFault):
    """Another device takes the place of a slave, as at power-on.

    Wires, waveforms and plants of the rig stay with the device that was there first; `original`
    puts that one back.
    """

    kind: ClassVar[str] = "swap"
    device: Annotated[
        str,
        Is(
            "name of the library (`ecatsim devices`), device file x.toml, class x.py:Class, "
            "SII image x.bin, or `original`",
            file=True,
        ),
    ]

    def check(self, target: Target) -> None:
        """Checks that the device exists."""
        if self.device != "original":
            named_devices.make(self.device)

    def strike(self, target: Target) -> None:
        """Puts the other device in place of the slave."""
        other = None if self.device == "original" else named_devices.make(self.device)
        target.swap(self.slave, other)


@dataclass(frozen=True)
class Module(SlaveFault):
    """Somebody puts another module into a slot of a modular device, which restarts.

    Wires, waveforms and plants of the rig stay with the device that was there first, as with
    `swap`; `swap SLAVE original` puts that one back.
    """

    kind: ClassVar[str] = "module"
    slot: Annotated[int, Is("the slot, 1 first", minimum=1, maximum=0xFF)]
    module: Annotated[str, Is("type of the module, such as DI8; `-` = the slot is empty")]

    def check(self, target: Target) -> None:
        """Checks that the device takes the module."""
        target.devices[self.slave].with_module(self.slot, self.module)

    def strike(self, target: Target) -> None:
        """Puts the module in."""
        target.swap(self.slave, target.devices[self.slave].with_module(self.slot, self.module))


@dataclass(frozen=True)
class Identification(SlaveFault):
    """Somebody sets the selector of a slave, which gives its device identification."""

    kind: ClassVar[str] = "identification"
    value: Annotated[int, Is("identification; 0 = none", minimum=0, maximum=_MAX_16)]

    def strike(self, target: Target) -> None:
        """Sets the selector."""
        target.devices[self.slave].select(self.value)


@dataclass(frozen=True)
class AlError(SlaveFault):
    """A slave falls back to a state by itself, with the error flag and an AL status code.

    A slave that is in a lower state stays there, with the error flag.
    """

    kind: ClassVar[str] = "al-error"
    code: Annotated[
        int, Is("AL status code, register 0x0134", minimum=1, maximum=_MAX_16, hexadecimal=True)
    ]
    state: Annotated[Literal["INIT", "PREOP", "SAFEOP"], Is("state that it falls back to")] = (
        "SAFEOP"
    )

    def strike(self, target: Target) -> None:
        """Sets AL status and AL status code."""
        target.powered(self.slave).fail(self.code, AlState[self.state])


@dataclass(frozen=True)
class Emergency(SlaveFault):
    """A slave sends an emergency through its mailbox, which works from PREOP on."""

    kind: ClassVar[str] = "emergency"
    code: Annotated[
        int,
        Is("error code; 0 = the error is gone", minimum=0, maximum=_MAX_16, hexadecimal=True),
    ]
    register: Annotated[
        int,
        Is("error register, object 0x1001", minimum=0, maximum=0xFF, hexadecimal=True),
    ] = 0
    data: Annotated[bytes, Is("the device's own data", maximum=5)] = b""

    def check(self, target: Target) -> None:
        """Checks that the slave has a mailbox."""
        _check_mailbox(self, target)

    def strike(self, target: Target) -> None:
        """Sends the emergency."""
        device = target.powered(self.slave)
        if device.machine.state < AlState.PREOP:
            raise StateError(
                f"slave {self.slave} is in {device.machine.state.name}: emergencies are sent from "
                "PREOP on"
            )
        device.emergency(self.code, self.register, self.data)


@dataclass(frozen=True)
class Mailbox(SlaveFault):
    """A mailbox answers late, never or with nonsense, or takes no mail. `none` ends the fault."""

    kind: ClassVar[str] = "mailbox"
    mode: Annotated[
        Literal["none", "slow", "stuck", "full", "garbage"],
        Is("slow: late answers; stuck: no answers; full: takes no mail; garbage: random answers"),
    ]
    delay_s: Annotated[
        float, Is("delay of answers when slow", unit="s", minimum=0.0, maximum=3600.0)
    ] = 1.0

    def check(self, target: Target) -> None:
        """Checks that the slave has a mailbox."""
        _check_mailbox(self, target)

    def strike(self, target: Target) -> None:
        """Sets the fault of the mailbox."""
        fault = MailboxFault(MailboxMode(self.mode), self.delay_s if self.mode == "slow" else 0.0)
        target.devices[self.slave].mailbox_fault = fault


@dataclass(frozen=True)
class Eeprom(SlaveFault):
    """The EEPROM of a slave gets another content; `restore` brings the original one back.

    The master reads the new content at once. The values that the slave controller loads from it
    (alias, PDI configuration, loaded bit) change when it loads the EEPROM again.
    """

    kind: ClassVar[str] = "eeprom"
    content: Annotated[
        Literal["checksum", "ones", "truncated", "image", "restore"],
        Is(
            "checksum: a wrong one; ones: 0xFF throughout; truncated: nothing behind its first "
            "128 bytes; image: a file"
        ),
    ]
    file: Annotated[str, Is("SII image, with `image`", file=True)] = ""
    at_power_on: Annotated[bool, Is("not now, but when the power is next switched on")] = False

    def _validate(self) -> None:
        if (self.content == "image") != bool(self.file):
            raise UsageError(f"{self.kind}: content `image`, and no other, takes a file")

    def check(self, target: Target) -> None:
        """Checks that the file can be read."""
        if self.file:
            named_devices.read_image(Path(self.file))

    def strike(self, target: Target) -> None:
        """Changes the content."""
        original = target.original_eeprom(self.slave)
        image = self._image(original)
        if self.at_power_on:
            target.eeprom_at_power_on(self.slave, image)
        else:
            target.segment.set_eeprom(self.slave, image)

    def _image(self, original: bytes) -> bytes:
        if self.content == "checksum":
            wrong = bytes([original[_CHECKSUM] ^ 0xFF]) if len(original) > _CHECKSUM else b""
            return original[:_CHECKSUM] + wrong + original[_CHECKSUM + 1 :]
        if self.content == "ones":
            return b"\xff" * len(original)
        if self.content == "truncated":
            return original[:_HEADER]
        if self.content == "image":
            return named_devices.read_image(Path(self.file))
        return original


@dataclass(frozen=True)
class Clock(SlaveFault):
    """The local clock of a slave jumps, or runs faster or slower."""

    kind: ClassVar[str] = "clock"
    step_ns: Annotated[
        int, Is("how far it jumps", unit="ns", minimum=-(10**18), maximum=10**18)
    ] = 0
    drift_ppm: Annotated[
        float | None,
        Is("how much faster it runs from now on", unit="ppm", minimum=-1000.0, maximum=1000.0),
    ] = None

    def check(self, target: Target) -> None:
        """Checks that the slave has a clock."""
        device = target.devices[self.slave]
        if not device.chip.dc:
            name = device.order or device.name
            raise UsageError(f"{self.kind}: slave {self.slave} ({name}) has no distributed clock")

    def _validate(self) -> None:
        if self.step_ns == 0 and self.drift_ppm is None:
            raise UsageError(f"{self.kind}: give step_ns, drift_ppm, or both")

    def strike(self, target: Target) -> None:
        """Sets the clock."""
        if self.drift_ppm is not None:
            target.segment.set_clock(self.slave, drift_ppm=self.drift_ppm)
        if self.step_ns:
            target.segment.step_clock(self.slave, self.step_ns)


@dataclass(frozen=True)
class Drift(SlaveFault):
    """The value of an input drifts away from the true one, as that of an ageing sensor.

    The process data have the wrong value; objects keep the true one. A rate of 0 ends it.
    """

    kind: ClassVar[str] = "drift"
    entry: Annotated[str, Is("address of a mapped input, such as 0x6000:01")]
    per_second: Annotated[
        float, Is("raw units in each second; 0 = true again", minimum=-1e9, maximum=1e9)
    ]
    limit: Annotated[
        float, Is("raw units at most; 0 = to the end of its type", minimum=0, maximum=1e9)
    ] = 0.0

    @property
    def address(self) -> tuple[int, int]:
        """Index and subindex of the entry."""
        found = parse_address(self.entry)
        if found is None:
            raise UsageError(f"{self.kind}: '{self.entry}' is no address: write 0x6000:01")
        return found

    def _validate(self) -> None:
        _ = self.address  # raises

    def check(self, target: Target) -> None:
        """Checks that the slave has such an input."""
        target.devices[self.slave].check_drift(self.address)

    def strike(self, target: Target) -> None:
        """Begins, changes or ends the drift."""
        target.devices[self.slave].drift(self.address, self.per_second, self.limit)


def _check_mailbox(fault: SlaveFault, target: Target) -> None:
    device = target.devices[fault.slave]
    if device.mailbox is None:
        raise UsageError(
            f"{fault.kind}: slave {fault.slave} ({device.order or device.name}) has no mailbox"
        )
