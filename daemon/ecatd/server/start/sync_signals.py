"""The SYNC signals of slaves: plans them, starts them in step with the cycle, stops them.

Registers: ETG.1000.4.
"""

from __future__ import annotations

import struct
import time
from collections import Counter
from collections.abc import Container
from dataclasses import dataclass

from ecatd.base.coroutine_steps import Steps
from ecatd.base.errors import ConfigError, StateError
from ecatd.base.timeouts import Timeout
from ecatd.base.toml_file import Table
from ecatd.config import Config, DcSlaveConfig
from ecatd.config.resolve.clocks import LEAD_NS, whole_period
from ecatd.description.bus import Bus, Slave
from ecatd.etg.sii_parts import read_dc_modes
from ecatd.master.engine.shared_memory import SharedMemory
from ecatd.master.frames.datagrams import Station
from ecatd.master.master import Master

from .clock_registers import SYNC_CONTROL, SYSTEM_TIME, number, signed

_PULSE_LENGTH, _PULSE_UNIT_NS = 0x0982, 10
_ACTIVATION_STATUS = 0x0984
_START = 0x0990
_CYCLES = 0x09A0  # of SYNC0 and SYNC1

_RUN, _SYNC0, _SYNC1, _SIGNALS = 0x0100, 0x0200, 0x0400, 0x0700
"""Bits of the word that the SII calls AssignActivate (registers 0x0980 and 0x0981)."""

_TRIES = 3
_CYCLES_ASKED = 5


@dataclass(slots=True)
class _SlaveSignals:
    """The SYNC signals of a slave.

    Attributes:
        slave: The slave, with the times of the signals.
        config: The table of the signals in the configuration.
        activation: The word for the registers 0x0980 and 0x0981; 0 for an optional slave that has
            not been there yet.
    """

    slave: Slave
    config: DcSlaveConfig
    activation: int = 0


class SyncSignals:
    """The SYNC signals of one bus.

    Args:
        bus: The bus.
        config: The configuration.
        master: The master.

    Raises:
        ConfigError: A slave cannot make the configured SYNC signals.
    """

    def __init__(self, bus: Bus, config: Config, master: Master) -> None:
        self._bus = bus
        self._config = config
        self._master = master
        self._signals = [_SlaveSignals(bus.slaves[item.slave], item) for item in config.dc.slave]
        for signals in self._signals:
            if signals.slave.position in master.wire:
                self._ask(signals)

    def has(self, position: int) -> bool:
        """Whether a slave has SYNC signals."""
        return any(signals.slave.position == position for signals in self._signals)

    def _ask(self, signals: _SlaveSignals) -> None:
        """Checks that the slave can make the signals, and reads their activation from its EEPROM.

        Raises:
            ConfigError: The slave cannot make these signals.
        """
        self._check_pulse_length(signals.slave, signals.config.table)
        signals.activation = self._activation(signals.slave)

    def _check_pulse_length(self, slave: Slave, table: Table) -> None:
        length = number(self._master.register_read(slave.position, _PULSE_LENGTH, 2))
        if slave.sync0_ns <= length * _PULSE_UNIT_NS:
            table.fail(
                "sync0_us",
                f"{slave.label} makes pulses of {length * _PULSE_UNIT_NS / 1000:g} µs, so SYNC0 "
                f"cannot come every {slave.sync0_ns / 1000:g} µs: choose a longer period",
            )

    def _activation(self, slave: Slave) -> int:
        """Returns AssignActivate, from the EEPROM if that has a mode with these signals."""
        wanted = _RUN | _SYNC0 | (_SYNC1 if slave.sync1_ns else 0)
        (modes,) = self._master.read_eeproms(read_dc_modes, [slave.position])
        known = (item.assign_activate for item in modes)
        return next((word for word in known if word & _SIGNALS == wanted), wanted)

    def start(
        self, shared: SharedMemory, positions: Container[int] | None = None
    ) -> Steps[dict[int, str]]:
        """Starts the SYNC signals of those slaves that have some, and waits for their first pulses.

        Args:
            shared: The shared memory, with the cycle and the time of the reference clock.
            positions: The slaves; None for all.

        Returns:
            By position, why a slave's signals do not start.
        """
        chosen = [s for s in self._signals if positions is None or s.slave.position in positions]
        failed: dict[int, str] = {}
        if not chosen:
            return failed
        zero = self._cycle_zero(shared)
        begun = []
        for signals in chosen:
            try:
                if not signals.activation:
                    self._ask(signals)
                yield from self._start(signals, shared, zero)
                begun.append((signals.slave, time.monotonic()))
            except (ConfigError, StateError) as error:
                failed[signals.slave.position] = str(error)
            yield
        for slave, since in begun:
            patience = _patience(slave)
            try:
                while (yield from self._waits_for_pulse(slave)):
                    if time.monotonic() > since + patience.seconds:
                        raise StateError(f"its SYNC signals do not begin within {patience}")
                    yield
            except StateError as error:
                failed[slave.position] = str(error)
        return failed

    def _cycle_zero(self, shared: SharedMemory) -> int:
        """Computes the start of cycle 0 by the reference clock, to align signals with cycles.

        A lost or late frame gives a wrong result, so this returns the most frequent one of several.
        """
        period, phase = self._bus.cycle_time_us * 1000, round(self._config.dc.phase_us * 1000)

        def zero() -> int:
            patience = Timeout(1 + 10 * period * 1e-9, "cycle_time_us above all tables")
            before, deadline = shared.header.cycle, time.monotonic() + patience.seconds
            while shared.header.cycle == before:
                if time.monotonic() > deadline:
                    raise StateError(f"the cyclic engine runs no cycle within {patience}")
                time.sleep(period * 1e-9 / 8)
            cycle, now = shared.header.cycle, shared.health.dc_time_ns
            # The frame passed the reference clock after the deadline, hardly ever before.
            return int((now - phase + period // 4) // period - cycle) * period

        return Counter(zero() for _ in range(_CYCLES_ASKED)).most_common(1)[0][0]

    def _start(self, signals: _SlaveSignals, shared: SharedMemory, zero: int) -> Steps[None]:
        """Sets up the signals of a slave; tries again if their start time has passed meanwhile."""
        master, slave = self._master, signals.slave
        position = slave.position
        cycles = struct.pack("<II", slave.sync0_ns, slave.sync1_ns)
        # The offset of the cycles that exchange its domain.
        turn = self._bus.domains[slave.domain].phase * self._bus.cycle_time_us * 1000
        whole, base = whole_period(slave), zero + turn + slave.sync_shift_ns
        for tries in range(1, _TRIES + 1):
            # Off, controlled by the master.
            yield from master.writing([(position, SYNC_CONTROL, bytes(2))])
            own = yield from self._system_time(slave)
            reference = shared.health.dc_time_ns
            now = reference + signed(own - reference)  # their upper halves may differ
            first = base - (base - now - tries * LEAD_NS) // whole * whole
            start = (own + first - now) % (1 << slave.dc_bits)
            yield from master.writing([(position, _CYCLES, cycles)])
            yield from master.writing([(position, _START, struct.pack("<Q", start))])
            activation = struct.pack("<H", signals.activation)
            yield from master.writing([(position, SYNC_CONTROL, activation)])
            own = yield from self._system_time(slave)
            if signed(start - own, slave.dc_bits) > 0:
                return
        raise StateError(
            f"setting up its SYNC signals took too long: {_TRIES} times, their start had passed"
        )

    def _system_time(self, slave: Slave) -> Steps[int]:
        wanted = slave.position, SYSTEM_TIME, slave.dc_bits // 8
        (data,) = yield from self._master.reading([wanted])
        return number(data)

    def _waits_for_pulse(self, slave: Slave) -> Steps[bool]:
        (status,) = yield from self._master.reading([(slave.position, _ACTIVATION_STATUS, 1)])
        return bool(number(status) & 0x03)

    def stop(self) -> None:
        """Stops all SYNC signals. Slaves that use them should be in INIT already."""
        slaves = [Station(signals.slave.address) for signals in self._signals]
        self._master.registers.exchange([slave.write(SYNC_CONTROL, bytes(2)) for slave in slaves])


def _patience(slave: Slave) -> Timeout:
    """Returns the time within which the first pulse must come."""
    seconds = (_TRIES * LEAD_NS + 2 * whole_period(slave)) * 1e-9 + 1.0
    return Timeout(seconds, "sync0_us in its [[dc.slave]] table")
