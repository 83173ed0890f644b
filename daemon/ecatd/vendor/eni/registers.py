"""Finds watchdogs and SYNC signals in the register commands of an ENI file (ETG.1000.4)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from .network import EniSlave, RegisterCommand

_WRITES = (2, 5, 8)  # APWR, FPWR, BWR
_NOTHING = 0  # NOP
_WAY_UP = ("IP", "PS", "SO")
_DIVIDER, _PDI_TIME, _TIME = 0x0400, 0x0410, 0x0420
_DIVIDER_DEFAULT, _DIVIDER_OFFSET, _TICK_NS = 2498, 2, 40
_ACTIVATION, _START, _CYCLES = 0x0980, 0x0990, 0x09A0
_SYNC0, _SYNC1 = 0x0300, 0x0400
_FMMUS = range(0x0600, 0x0700)
_FMMU_BYTES = 16
_SYNC_MANAGERS = range(0x0800, 0x0900)

_OURS = (
    (0x0000, 0x0010, "what kind of ESC a slave has"),
    (0x0010, 0x0014, "station addresses"),
    (0x0100, 0x0112, "ports and forwarding"),
    (0x0120, 0x0136, "AL states"),
    (0x0200, 0x0224, "event masks"),
    (0x0300, 0x0314, "error counters"),
    (0x0400, 0x0444, "watchdogs"),
    (0x0500, 0x0510, "EEPROMs, and the identity in them"),
    (0x0600, 0x0700, "FMMUs and logical addresses"),
    (0x0800, 0x0900, "sync managers"),
    (0x0900, 0x0A00, "distributed clocks"),
)


@dataclass(frozen=True, slots=True)
class Sync:
    """The SYNC signals of a slave.

    Attributes:
        activation: AssignActivate, the word in the registers 0x0980 and 0x0981.
        cycle0_ns: Period of SYNC0.
        sync1_ns: Time from SYNC0 to SYNC1 (0x09A4); 0: no SYNC1.
        shift_ns: Shift of SYNC0.
    """

    activation: int
    cycle0_ns: int
    sync1_ns: int
    shift_ns: int


class Memory:
    """The registers of a slave after all commands on the way to OP."""

    def __init__(self, slave: EniSlave) -> None:
        self._slave = slave
        self._bytes: dict[int, int] = {}
        for transition in _WAY_UP:
            for command in slave.registers:
                if command.command in _WRITES and transition in command.transitions:
                    self._bytes |= dict(enumerate(command.data, command.register))

    def _number(self, register: int, size: int, default: int = 0) -> int:
        if register not in self._bytes:
            return default
        data = bytes(self._bytes.get(register + n, 0) for n in range(size))
        return int.from_bytes(data, "little")

    def watchdogs_ms(self) -> tuple[float | None, float | None]:
        """Times of the process data and of the PDI watchdog; None: the file does not set it."""
        divider = self._number(_DIVIDER, 2, _DIVIDER_DEFAULT)
        tick_ms = (divider + _DIVIDER_OFFSET) * _TICK_NS / 1e6
        data, pdi = (
            self._number(register, 2) * tick_ms if register in self._bytes else None
            for register in (_TIME, _PDI_TIME)
        )
        return data, pdi

    def sync(self) -> Sync | None:
        """The SYNC signals; None if the slave has none."""
        activation = self._number(_ACTIVATION, 2)
        if activation & _SYNC0 != _SYNC0:
            return None
        start = self._number(_START, 8)
        clock = self._slave.clock
        return Sync(
            activation,
            self._number(_CYCLES, 4) or (clock.cycle0_ns if clock else 0),
            self._number(_CYCLES + 4, 4) if activation & _SYNC1 else 0,
            clock.shift_ns if clock else start - (start >> 63 << 64),
        )

    def logical_addresses(self) -> Iterator[int]:
        """First logical address of each FMMU that is switched on."""
        for fmmu in range(_FMMUS.start, _FMMUS.stop, _FMMU_BYTES):
            active = self._number(fmmu + 12, 1) & 1 and self._number(fmmu + 11, 1) & 3
            if active and self._number(fmmu + 8, 2) not in _SYNC_MANAGERS:  # a mailbox's state
                yield self._number(fmmu, 4)


def whose(command: RegisterCommand) -> str:
    """What ecatd does in place of this command, in words; empty if it does nothing."""
    if command.command == _NOTHING:
        return "pauses"
    for low, high, what in _OURS:
        if low <= command.register < high:
            return what
    return ""
