"""The distributed clocks of a bus (ETG.1000.4): found, measured, followed; SYNC signals.

Order matters: `Clocks()`, which checks what is wanted, and `measure` in PREOP; then the engine
starts, which distributes the time of the reference clock in every cycle; `wait_for_lock`;
`start_signals`; and only then SAFEOP, where slaves want to see their signals. `stop_signals` comes
when slaves are back in INIT.

Times of a clock are ns since 2000-01-01 00:00 UTC, and in a clock of 32 bits their lower half.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from statistics import mode

from ecatd.model.bus import Bus, Slave
from ecatd.model.config import Config, DcSlaveConfig
from ecatd.model.errors import ConfigError, StateError
from ecatd.model.sii import read_dc_modes
from ecatd.shm import DcState

from ..datagrams import bwr
from ..engine import Clock
from ..master import Master
from ..segment import Segment
from .delays import Ports, arrivals, arrivals_at_both_ends, reached, way_out

_FEATURES, _HAS_CLOCK, _HAS_64_BITS = 0x0008, 0x04, 0x08
_LOOP_CONTROL, _LOOP_CLOSED = 0x0101, 0x03  # two bits a port
_DL_STATUS = 0x0110
_PORT_TIMES = 0x0900
_SYSTEM_TIME = 0x0910
_UNIT_TIME = 0x0918
_OFFSET = 0x0920  # followed by the delay, 0x0928
_DELAY = 0x0928
_DIFFERENCE = 0x092C
_SPEED_START, _SPEED_START_DEFAULT = 0x0930, 0x1000
_SYNC_CONTROL = 0x0980  # followed by the activation, 0x0981
_PULSE_LENGTH, _PULSE_UNIT_NS = 0x0982, 10
_ACTIVATION_STATUS = 0x0984
_START = 0x0990
_CYCLES = 0x09A0  # of SYNC0 and SYNC1

_RUN, _SYNC0, _SYNC1, _SIGNALS = 0x0100, 0x0200, 0x0400, 0x0700
"""In the word that the SII calls AssignActivate: registers 0x0980 and 0x0981."""

_EPOCH_NS = 946_684_800_000_000_000  # 2000-01-01, since 1970-01-01
IN_STEP_NS = 1000
"""How close the clocks of slaves are to the reference clock before SYNC signals start."""
_STEADY = 3  # looks in a row
_POLL = 0.01
_TRIES = 3
_CYCLES_ASKED = 5
_LEAD_NS = 100_000_000  # from the set-up of a signal to its first pulse
_NEAR_NS = 2_000_000_000  # what a clock of 32 bits can tell from the past


def clock_bits(master: Master) -> list[int]:
    """Width of the distributed clock of each slave: 64, 32, or 0 if it has none.

    A controller with clocks may have them switched off by its EEPROM; register 0x0910 does not
    answer then, and the receive times of the ports are all that is left.
    """
    wanted = [(position, _FEATURES, 2) for position in range(len(master.stations))]
    bits = []
    times = master.registers.read_all(master.stations, _SYSTEM_TIME, 4)
    for data, time_ in zip(master.read_registers(wanted), times, strict=True):
        has_clock = _number(data) & _HAS_CLOCK and time_.wkc
        bits.append(0 if not has_clock else 64 if _number(data) & _HAS_64_BITS else 32)
    return bits


@dataclass(frozen=True, slots=True)
class _Signals:
    """The SYNC signals of a slave.

    Attributes:
        slave: The slave, with their times.
        activation: What goes to the registers 0x0980 and 0x0981.
    """

    slave: Slave
    activation: int


class Clocks:
    """The clocks of one bus, where the configuration wants them.

    Args:
        bus: The bus; `dc_bits` of its slaves are known.
        config: The configuration.
        master: Reads and writes registers.

    Attributes:
        reference: The slave with the reference clock.
        followers: Slaves whose clocks follow it.

    Raises:
        ConfigError: This bus cannot do what the configuration wants.
    """

    def __init__(self, bus: Bus, config: Config, master: Master) -> None:
        self._bus = bus
        self._config = config
        self._master = master
        self._clocks = [slave for slave in bus.slaves if slave.dc_bits]
        self.reference = self._choose_reference()
        self.followers = [s for s in self._clocks if s.position > self.reference.position]
        self._hearing = self.followers  # those that the time comes to, and not only an estimate
        self._signals = [self._plan(item) for item in config.dc.slave]

    def _choose_reference(self) -> Slave:
        wanted = self._config.dc.reference
        if not self._clocks:
            raise ConfigError(
                f"dc: no slave of bus '{self._bus.name}' has a distributed clock: leave [dc] out"
            )
        if wanted < 0:
            return self._clocks[0]
        return self._with_clock("dc.reference", wanted)

    def _with_clock(self, key: str, position: int) -> Slave:
        slaves = self._bus.slaves
        if position >= len(slaves):
            raise ConfigError(
                f"{key}: there is no slave {position}: bus '{self._bus.name}' has {len(slaves)}"
            )
        if not slaves[position].dc_bits:
            others = ", ".join(str(slave.position) for slave in self._clocks)
            raise ConfigError(
                f"{key}: {slaves[position].label} has no distributed clock; those with one are: "
                f"{others}"
            )
        return slaves[position]

    def _plan(self, item: DcSlaveConfig) -> _Signals:
        """Checks the signals of a slave, and notes them in its description."""
        slave, reference = self._with_clock("dc.slave", item.slave), self.reference
        if slave.position < reference.position:
            raise ConfigError(
                f"dc.slave: {slave.label} cannot follow the reference clock, {reference.label}: "
                f"the frame that brings its time passes only the slaves behind it; choose a "
                f"reference at or before slave {slave.position}"
            )
        slave.sync0_ns = round(self._config.sync0_us(item) * 1000)
        slave.sync1_ns = round(item.sync1_us * 1000)
        slave.sync_shift_ns = round(self._config.shift_us(item) * 1000)
        if slave.dc_bits == 32 and _whole_period(slave) > _NEAR_NS - _LEAD_NS:
            raise ConfigError(
                f"dc.slave: {slave.label} has a clock of 32 bits, which cannot tell times that are "
                f"more than {_NEAR_NS * 1e-9:g} s away: its signals must come more often"
            )
        self._check_pulse_length(slave)
        return _Signals(slave, self._activation(slave))

    def _check_pulse_length(self, slave: Slave) -> None:
        length = _number(self._master.register_read(slave.position, _PULSE_LENGTH, 2))
        if slave.sync0_ns <= length * _PULSE_UNIT_NS:
            raise ConfigError(
                f"dc.slave: {slave.label} makes pulses of {length * _PULSE_UNIT_NS / 1000:g} µs, "
                f"so SYNC0 cannot come every {slave.sync0_ns / 1000:g} µs"
            )

    def _activation(self, slave: Slave) -> int:
        """Which signals, and who controls them: as the EEPROM has it, if it knows such a mode."""
        wanted = _RUN | _SYNC0 | (_SYNC1 if slave.sync1_ns else 0)
        (modes,) = self._master.read_eeproms(read_dc_modes, [slave.position])
        known = (item.assign_activate for item in modes)
        return next((word for word in known if word & _SIGNALS == wanted), wanted)

    @property
    def engine_clock(self) -> Clock:
        """What the engine has to know."""
        dc, slave = self._config.dc, self.reference
        return Clock(
            slave.address, slave.position, round(dc.phase_us * 1000), round(dc.lock_us * 1000)
        )

    # --- delays --------------------------------------------------------------------------------

    def measure(self) -> None:
        """Measures the propagation delays, and sets all clocks to the time of the reference clock.

        Raises:
            StateError: The measurement makes no sense, or a slave does not answer.
        """
        with self._ring_open():
            times, now = self._latch()
        origin = times[self.reference.position] or 0.0
        places = [slave.position for slave in self._clocks]
        units = self._read(
            [(slave.position, _UNIT_TIME, slave.dc_bits // 8) for slave in self._clocks]
        )
        writes = []
        for slave, then in zip(self._clocks, units, strict=True):
            # When the frame came to it, it was later than at the reference clock by the delay.
            delay = round((times[slave.position] or 0.0) - origin)
            offset = (now + delay - then) % (1 << slave.dc_bits)
            # A clock before the reference clock does not follow it: its delay does not matter.
            writes.append((slave.position, _OFFSET, struct.pack("<QI", offset, max(0, delay))))
            # What the control loop of the clock has learnt with an earlier master is forgotten.
            writes.append((slave.position, _SPEED_START, struct.pack("<H", _SPEED_START_DEFAULT)))
        self._master.write_registers(writes)
        delays = self._read([(place, _DELAY, 4) for place in places])
        for slave, delay in zip(self._clocks, delays, strict=True):
            slave.dc_delay_ns = delay

    @contextmanager
    def _ring_open(self) -> Iterator[None]:
        """Meanwhile frames come back the way they went; else no slave could tell how long it took.

        In a closed ring they leave by the second interface. So the last slave closes the port
        that leads there (DL control, ETG.1000.4).
        """
        ports = self._ports() if self._config.second_interface else []
        end = way_out(ports) if reached(ports) == len(ports) else None
        if end is None:
            yield
            return
        position, port = end
        control = self._master.register_read(position, _LOOP_CONTROL, 1)
        closed = bytes([control[0] | _LOOP_CLOSED << 2 * port])
        self._master.register_write(position, _LOOP_CONTROL, closed)
        try:
            yield
        finally:
            self._master.register_write(position, _LOOP_CONTROL, control)

    def _latch(self) -> tuple[list[float | None], int]:
        """Sends the frame whose way is measured; when it came to each slave, and the time."""
        for tries_left in reversed(range(_TRIES)):
            (latch,) = self._master.registers.exchange([bwr(_PORT_TIMES, bytes(4))], repeat=False)
            now = time.time_ns() - _EPOCH_NS
            try:
                if latch.wkc:  # else it was lost on its way, and some slaves did not see it return
                    return self._arrivals(), now
            except StateError as error:
                if tries_left == 0:
                    raise StateError(f"propagation delays cannot be measured: {error}") from error
        raise StateError("propagation delays cannot be measured: frames get lost")

    def _arrivals(self) -> list[float | None]:
        """When the frame came to each slave; with a broken ring, as if it were whole."""
        ports = self._ports()
        count = reached(ports)
        if count == len(ports) or not self._config.second_interface:
            return arrivals(ports)
        near = self.reference.position < count
        self._hearing = [slave for slave in self.followers if (slave.position < count) == near]
        return arrivals_at_both_ends(ports, count)

    def _ports(self) -> list[Ports]:
        """Open ports with somebody at the other end, and receive times where there are any."""
        places = [slave.position for slave in self._bus.slaves]
        status = self._read([(place, _DL_STATUS, 2) for place in places])
        features = self._read([(place, _FEATURES, 2) for place in places])
        timed = [place for place in places if features[place] & _HAS_CLOCK]
        latched = self._master.read_registers([(place, _PORT_TIMES, 16) for place in timed])
        times = {
            place: struct.unpack("<4I", data) for place, data in zip(timed, latched, strict=True)
        }
        return [
            Ports(
                # Two bits a port: loop closed, communication established.
                frozenset(port for port in range(4) if status[place] >> 8 + 2 * port & 3 == 2),
                times.get(place),
            )
            for place in places
        ]

    def _read(self, wanted: list[tuple[int, int, int]]) -> list[int]:
        """Numbers in registers: position, address and bytes of each."""
        return [_number(data) for data in self._master.read_registers(wanted)]

    # --- lock ----------------------------------------------------------------------------------

    def differences(self) -> dict[int, int]:
        """How far the followers are ahead of the reference clock, in ns (0x092C), by position.

        Those that do not answer are left out.
        """
        stations = [slave.address for slave in self.followers]
        answers = self._master.registers.read_all(stations, _DIFFERENCE, 4)
        return {
            slave.position: _difference(answer.data)
            for slave, answer in zip(self.followers, answers, strict=True)
            if answer.wkc
        }

    def wait_for_lock(self, segment: Segment, cancelled: Callable[[], bool]) -> float:
        """Waits until the cycle and all clocks follow the reference clock; returns the seconds.

        Args:
            segment: Where the engine tells the state of its lock.
            cancelled: Asked while waiting; when true, the wait ends with `StateError`.

        Raises:
            StateError: That takes too long; the message has the figures.
        """
        begin, steady = time.monotonic(), 0
        while True:
            locked = segment.health.dc_state == DcState.LOCKED
            differences = self.differences()
            in_step = all(
                abs(differences.get(slave.position, IN_STEP_NS + 1)) <= IN_STEP_NS
                for slave in self._hearing
            )
            steady = steady + 1 if locked and in_step else 0
            waited = time.monotonic() - begin
            if steady == _STEADY:
                return waited
            if waited > self._config.dc.timeout_s:
                raise StateError(self._why_not(segment, locked, differences))
            if cancelled():
                raise StateError("stopped while distributed clocks were waited for")
            time.sleep(_POLL)

    def _why_not(self, segment: Segment, locked: bool, differences: dict[int, int]) -> str:
        health, dc = segment.health, self._config.dc
        text = f"distributed clocks are not in step after {dc.timeout_s:g} s: "
        if health.dc_time_ns == 0:
            return f"{text}the reference clock, {self.reference.label}, tells no time"
        text += (
            f"the cycle is {'' if locked else 'not locked, '}{health.dc_offset_ns / 1000:.1f} µs "
            f"from the reference clock, {self.reference.label}, whose rate differs from this "
            f"computer's by {health.dc_drift_ppb / 1000:+.1f} ppm"
        )
        astray = [
            f"slave {position} by {difference / 1000:.1f} µs"
            for position, difference in differences.items()
            if abs(difference) > IN_STEP_NS
        ]
        silent = [s.position for s in self.followers if s.position not in differences]
        if silent:
            text += f"; no answer from slaves {', '.join(map(str, silent[:8]))}"
        if astray:
            text += f"; clocks that differ from it: {', '.join(astray[:8])}"
            text += f" and {len(astray) - 8} more" if len(astray) > 8 else ""
        if not locked:
            text += f"; a computer with less precise timers needs more than {dc.lock_us:g} µs for "
            text += "dc.lock_us"
        return text

    # --- SYNC signals --------------------------------------------------------------------------

    def start_signals(self, segment: Segment) -> None:
        """Starts the SYNC signals of all slaves that have some, and waits for their first pulse.

        Raises:
            StateError: A slave does not start them.
        """
        if not self._signals:
            return
        zero = self._cycle_zero(segment)
        for signals in self._signals:
            self._start(signals, segment, zero)
        for signals in self._signals:
            self._wait_for_pulse(signals.slave)

    def _cycle_zero(self, segment: Segment) -> int:
        """When cycle 0 began, on the clock of the reference: signals go with certain cycles.

        A frame that was lost or late gives another cycle, so several are asked.
        """
        period, phase = self._bus.cycle_time_us * 1000, round(self._config.dc.phase_us * 1000)

        def zero() -> int:
            before, deadline = segment.header.cycle, time.monotonic() + 1 + 10 * period * 1e-9
            while segment.header.cycle == before:
                if time.monotonic() > deadline:
                    raise StateError("the cyclic engine does not run")
                time.sleep(period * 1e-9 / 8)
            cycle, now = segment.header.cycle, segment.health.dc_time_ns
            # The frame passed the reference clock after the deadline, hardly ever before.
            return int((now - phase + period // 4) // period - cycle) * period

        return mode(zero() for _ in range(_CYCLES_ASKED))

    def _start(self, signals: _Signals, segment: Segment, zero: int) -> None:
        """Sets the signals of a slave up; again if this takes so long that the start has passed."""
        master, slave = self._master, signals.slave
        position = slave.position
        cycles = struct.pack("<II", slave.sync0_ns, slave.sync1_ns)
        # The cycles that carry its domain.
        turn = self._bus.domains[slave.domain].phase * self._bus.cycle_time_us * 1000
        whole, base = _whole_period(slave), zero + turn + slave.sync_shift_ns
        for tries in range(1, _TRIES + 1):
            master.register_write(position, _SYNC_CONTROL, bytes(2))  # off, and ours
            own = self._system_time(slave)
            reference = segment.health.dc_time_ns
            now = reference + _signed(own - reference)  # the upper half may be another one
            first = base - (base - now - tries * _LEAD_NS) // whole * whole
            start = (own + first - now) % (1 << slave.dc_bits)
            master.register_write(position, _CYCLES, cycles)
            master.register_write(position, _START, struct.pack("<Q", start))
            master.register_write(position, _SYNC_CONTROL, struct.pack("<H", signals.activation))
            if _signed(start - self._system_time(slave), slave.dc_bits) > 0:
                return
        raise StateError(f"{slave.label}: its SYNC signals cannot be set up before they begin")

    def _system_time(self, slave: Slave) -> int:
        data = self._master.register_read(slave.position, _SYSTEM_TIME, slave.dc_bits // 8)
        return _number(data)

    def _wait_for_pulse(self, slave: Slave) -> None:
        patience = (_TRIES * _LEAD_NS + 2 * _whole_period(slave)) * 1e-9 + 1.0
        deadline = time.monotonic() + patience
        while _number(self._master.register_read(slave.position, _ACTIVATION_STATUS, 1)) & 0x03:
            if time.monotonic() > deadline:
                raise StateError(f"{slave.label}: its SYNC signals do not begin")
            time.sleep(_POLL)

    def stop_signals(self) -> None:
        """Ends the SYNC signals; slaves that go by them should be in INIT by then."""
        for signals in self._signals:
            with suppress(StateError):  # one that is gone has none any more
                self._master.register_write(signals.slave.position, _SYNC_CONTROL, bytes(2))


def _whole_period(slave: Slave) -> int:
    """After which SYNC0 and SYNC1 come together again in the same way, in ns.

    SYNC1 follows SYNC0 after `sync1_ns`; where that is longer than a period of SYNC0, it follows
    each time the first SYNC0 after itself.
    """
    return (slave.sync1_ns // slave.sync0_ns + 1) * slave.sync0_ns


def _number(data: bytes) -> int:
    return int.from_bytes(data, "little")


def _signed(value: int, bits: int = 32) -> int:
    """A difference of two times of which the lower bits are known."""
    half = 1 << bits - 1
    return (value + half) % (2 * half) - half


def _difference(data: bytes) -> int:
    """Register 0x092C: magnitude, and in bit 31 whether the own time was not behind.

    So it is in the newer data sheets and in what real slaves answer; ETG.1000.4 has the bit the
    other way round.
    """
    value = _number(data)
    return value & 0x7FFFFFFF if value >> 31 else -value
