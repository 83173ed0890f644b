"""The distributed clocks of a bus (ETG.1000.4): finds them, measures delays, keeps them in step.

These steps must be in order:

1. In PREOP: `Clocks()`, which checks that the slaves can make their SYNC signals, and `measure`.
2. The engine starts. It distributes the time of the reference clock in every cycle.
3. `wait_for_lock`, and then `sync_signals.start`.
4. SAFEOP, where slaves expect their SYNC signals.
5. `sync_signals.stop`, when the slaves are back in INIT.

`rejoin` brings the clock of a slave in step again after the slave was without power.

Times of a clock are ns since 2000-01-01 00:00 UTC; a clock of 32 bits has the lower 32 bits.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager

from ecatd.base.coroutine_steps import Steps
from ecatd.base.errors import StateError
from ecatd.config import Config
from ecatd.config.resolve.clocks import ClockPlan
from ecatd.description.bus import Bus, Slave
from ecatd.master.engine.engine import Clock
from ecatd.master.engine.shared_memory import SharedMemory
from ecatd.master.frames.datagrams import Place, Station, brd, bwr
from ecatd.master.frames.topology import Ports, reached, way_out
from ecatd.master.master import Master
from ecatd.shm.contract import DcState, Ring

from .clock_registers import (
    DELAY,
    DIFFERENCE,
    OFFSET,
    SPEED_START,
    SPEED_START_DEFAULT,
    SYSTEM_TIME,
    arrivals,
    arrivals_at_both_ends,
    difference,
    number,
)
from .sync_signals import SyncSignals

_FEATURES, _HAS_CLOCK, _HAS_64_BITS = 0x0008, 0x04, 0x08
_LOOP_CONTROL, _LOOP_CLOSED = 0x0101, 0x03  # two bits a port
_STATION_ADDRESS, _DL_STATUS = 0x0010, 0x0110
_PORT_TIMES = 0x0900
_UNIT_TIME = 0x0918

_EPOCH_NS = 946_684_800_000_000_000  # 2000-01-01, since 1970-01-01
IN_STEP_NS = 1000
"""Largest difference of a slave's clock from the reference clock when SYNC signals start."""
_STEADY = 3  # reads in a row with all clocks in step
_POLL = 0.01
_TRIES = 3
_ASKED = 8  # slaves whose time is read when the reference clock has lost its time
_RING_OPEN_NS = 100_000
"""The limit instead of `IN_STEP_NS` while the ring is broken. The time of the reference clock then
does not reach all slaves; the others follow the engine's estimate of it."""


def clock_bits(master: Master) -> dict[int, int]:
    """Reads the width of the distributed clock of each slave that is there, by position.

    The width is 64 or 32 bits, or 0 without a clock. The EEPROM may switch off the clock of an ESC.
    Then register 0x0910 does not answer, and only the receive times of the ports are left.
    """
    features = master.read_registers([(position, _FEATURES, 2) for position in master.wire])
    stations = [master.stations[position] for position in master.wire]
    times = master.registers.read_all(stations, SYSTEM_TIME, 4)
    bits = {}
    for position, data, time_ in zip(master.wire, features, times, strict=True):
        has_clock = number(data) & _HAS_CLOCK and time_.wkc
        bits[position] = 0 if not has_clock else 64 if number(data) & _HAS_64_BITS else 32
    return bits


class Clocks:
    """The distributed clocks of one bus.

    Args:
        bus: The bus; `dc_bits` of its slaves are known.
        config: The configuration.
        plan: The reference clock, and the clocks that follow it.
        master: The master.

    Attributes:
        reference: The slave with the reference clock.
        followers: Slaves whose clocks follow it.
        sync_signals: The SYNC signals.

    Raises:
        ConfigError: A slave cannot make the configured SYNC signals.
    """

    def __init__(self, bus: Bus, config: Config, plan: ClockPlan, master: Master) -> None:
        self._bus = bus
        self._config = config
        self._master = master
        self._clocks = [slave for slave in bus.slaves if slave.dc_bits]
        self._measured = set(master.wire)  # positions of the slaves whose delays are known
        self.reference, self.followers = plan.reference, plan.followers
        # Followers that are there, and get the time of the reference clock, not only an estimate.
        self._in_reach = [s for s in self.followers if s.position in self._measured]
        self.sync_signals = SyncSignals(bus, config, master)

    @property
    def engine_clock(self) -> Clock:
        """The settings of the reference clock for the engine."""
        dc, slave = self._config.dc, self.reference
        return Clock(
            slave.address, slave.position, round(dc.phase_us * 1000), round(dc.lock_us * 1000)
        )

    # --- delays --------------------------------------------------------------------------------

    def measure(self) -> None:
        """Measures the propagation delays, and sets all clocks to the time of the reference clock.

        Raises:
            StateError: The measured times contradict each other, or a slave does not answer.
        """
        with self._ring_open():
            times, now = self._latch()
        origin = times[self.reference.position] or 0.0
        here = [slave for slave in self._clocks if slave.position in times]
        units = self._read([(slave.position, _UNIT_TIME, slave.dc_bits // 8) for slave in here])
        writes = []
        for slave, then in zip(here, units, strict=True):
            # The frame reached this clock later than the reference clock, by the delay.
            delay = round((times[slave.position] or 0.0) - origin)
            offset = (now + delay - then) % (1 << slave.dc_bits)
            # A clock before the reference clock does not follow it: its delay does not matter.
            writes.append((slave.position, OFFSET, struct.pack("<QI", offset, max(0, delay))))
            # Resets the control loop of the clock, which may still follow an earlier master.
            writes.append((slave.position, SPEED_START, struct.pack("<H", SPEED_START_DEFAULT)))
        self._master.write_registers(writes)
        delays = self._read([(slave.position, DELAY, 4) for slave in here])
        for slave, delay in zip(here, delays, strict=True):
            slave.dc_delay_ns = delay

    def _measure_again(self, slaves: Collection[Slave], shared: SharedMemory) -> Steps[None]:
        """Measures the delays again if there are optional slaves among those that have come back.

        They are on the way to the slaves after them, so the delays of all slaves that are there are
        measured. With a second interface nothing is measured, because the ring would have to be
        opened for it. Then known delays stay, and a new slave gets the largest delay of the slaves
        before it.
        """
        new = [slave for slave in slaves if slave.position not in self._measured]
        self._measured.update(slave.position for slave in new)
        if self._config.second_interface:
            for slave in new:
                before = [s.dc_delay_ns for s in self._clocks if s.position < slave.position]
                slave.dc_delay_ns = max(before, default=0)
        elif any(slave.group for slave in slaves):
            times, _ = self._latch()
            origin = times.get(self.reference.position) or 0.0
            writes = []
            for slave in self._clocks:
                if (arrival := times.get(slave.position)) is not None:
                    slave.dc_delay_ns = max(0, round(arrival - origin))
                    writes.append((slave.position, DELAY, struct.pack("<I", slave.dc_delay_ns)))
            yield from self._master.writing(writes)
        for slave in self._clocks:
            shared.slaves[slave.position].dc_delay_ns = slave.dc_delay_ns

    @contextmanager
    def _ring_open(self) -> Iterator[None]:
        """Opens a closed ring during the block, so that frames go back by the way they came.

        Delays are measured by the times at which a frame passes a slave on its way out and on its
        way back. In a closed ring, the frame does not come back but goes on to the second
        interface. So the last slave closes the port that leads there (DL control, ETG.1000.4).
        """
        ports = self._ports() if self._config.second_interface else []
        end = way_out(ports) if reached(ports) == len(ports) else None
        if end is None:
            yield
            return
        place, port = end
        position = self._master.wire[place]
        control = self._master.register_read(position, _LOOP_CONTROL, 1)
        closed = bytes([control[0] | _LOOP_CLOSED << 2 * port])
        self._master.register_write(position, _LOOP_CONTROL, closed)
        try:
            yield
        finally:
            self._master.register_write(position, _LOOP_CONTROL, control)

    def _latch(self) -> tuple[dict[int, float | None], int]:
        """Sends the frame whose times of arrival are measured (a write to 0x0900).

        Returns:
            The times of arrival at the slaves that are there, by position (see `arrivals`), and the
            computer's time in ns since 2000.

        Raises:
            StateError: Frames get lost, or the times contradict each other.
        """
        for tries_left in reversed(range(_TRIES)):
            (latch,) = self._master.registers.exchange([bwr(_PORT_TIMES, bytes(4))], repeat=False)
            now = time.time_ns() - _EPOCH_NS
            try:
                if latch.wkc:  # else the frame was lost, so some slaves did not see it come back
                    return self._arrivals(), now
            except StateError as error:
                if tries_left == 0:
                    raise StateError(f"propagation delays cannot be measured: {error}") from error
        raise StateError("propagation delays cannot be measured: frames get lost")

    def _arrivals(self) -> dict[int, float | None]:
        """Returns the frame's time of arrival at each slave; a broken ring counts as closed."""
        ports = self._ports()
        addresses = self._read_places([*range(len(ports))], _STATION_ADDRESS, 2)
        positions = {slave.address: slave.position for slave in self._bus.slaves}
        wire = [positions.get(number(address), -1) for address in addresses]
        count = reached(ports)
        if count == len(ports) or not self._config.second_interface:
            return dict(zip(wire, arrivals(ports), strict=True))
        near = self.reference.position in wire[:count]
        self._in_reach = [
            s for s in self.followers if s.position in wire and (s.position in wire[:count]) == near
        ]
        return dict(zip(wire, arrivals_at_both_ends(ports, count), strict=True))

    def _ports(self) -> list[Ports]:
        """Reads the ports with a link of each device, and their receive times if it has any.

        The devices are in the order of the wire, including those that do not belong to the bus.
        """
        (all_,) = self._master.registers.exchange([brd(_DL_STATUS, 2)])
        places = range(all_.wkc)
        status = [number(data) for data in self._read_places(places, _DL_STATUS, 2)]
        features = [number(data) for data in self._read_places(places, _FEATURES, 2)]
        timed = [place for place in places if features[place] & _HAS_CLOCK]
        latched = self._read_places(timed, _PORT_TIMES, 16)
        times = {
            place: struct.unpack("<4I", data) for place, data in zip(timed, latched, strict=True)
        }
        return [Ports.with_status(status[place], times.get(place)) for place in places]

    def _read_places(self, places: Sequence[int], register: int, size: int) -> list[bytes]:
        """Reads a register of the slaves at some places.

        Raises:
            StateError: A slave does not answer.
        """
        for _ in range(_TRIES):
            answers = self._master.registers.exchange(
                [Place(place).read(register, size) for place in places]
            )
            if all(answer.wkc for answer in answers):
                return [answer.data for answer in answers]
        raise StateError("slaves come and go meanwhile")

    def _read(self, wanted: list[tuple[int, int, int]]) -> list[int]:
        """Reads numbers from registers; `wanted` has position, address and bytes of each."""
        return [number(data) for data in self._master.read_registers(wanted)]

    # --- lock ----------------------------------------------------------------------------------

    def differences(self) -> dict[int, int]:
        """Reads the times in ns by which followers are ahead of the reference clock (0x092C).

        Returns:
            The times by position, without the slaves that do not answer.
        """
        stations = [slave.address for slave in self.followers]
        answers = self._master.registers.read_all(stations, DIFFERENCE, 4)
        return {
            slave.position: difference(answer.data)
            for slave, answer in zip(self.followers, answers, strict=True)
            if answer.wkc
        }

    def wait_for_lock(
        self, shared: SharedMemory, cancelled: Callable[[], bool], lost: Collection[int] = ()
    ) -> float:
        """Waits until the cycle and all clocks follow the reference clock.

        Args:
            shared: The shared memory, where the engine publishes the state of its lock.
            cancelled: Called while waiting; when it returns true, the wait ends with `StateError`.
            lost: Positions of slaves that are not there any more.

        Returns:
            The time that it took, in seconds.

        Raises:
            StateError: It takes longer than `dc.timeout_s`; the message has the figures.
        """
        begin, steady = time.monotonic(), 0
        while True:
            locked = shared.health.dc_state == DcState.LOCKED
            differences = self.differences()
            in_step = all(
                abs(differences.get(slave.position, IN_STEP_NS + 1)) <= IN_STEP_NS
                for slave in self._in_reach
                if slave.position not in lost
            )
            steady = steady + 1 if locked and in_step else 0
            waited = time.monotonic() - begin
            if steady == _STEADY:
                return waited
            if waited > self._config.dc.timeout.seconds:
                raise StateError(self._why_not(shared, locked, differences))
            if cancelled():
                raise StateError("stopped while distributed clocks were waited for")
            time.sleep(_POLL)

    def _why_not(self, shared: SharedMemory, locked: bool, differences: dict[int, int]) -> str:
        health, dc = shared.health, self._config.dc
        text = f"distributed clocks are not in step within {dc.timeout}: "
        if health.dc_time_ns == 0:
            return f"{text}the time of the reference clock, {self.reference.label}, cannot be read"
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
            text += (
                "; if the timers of this computer are less precise, set dc.lock_us to more than "
            )
            text += f"{dc.lock_us:g} µs"
        return text

    # --- slaves that come back -----------------------------------------------------------------

    def restart_reference(self, place: Place) -> None:
        """Sets the time of a reference clock that was without power.

        Call it before the slave gets its station address back, since the cycle follows the clock
        from then on. The clock is set to the time of the other clocks, so that their SYNC pulses
        keep their times. If none of them has kept its time, it is set to that of this computer.

        Args:
            place: The place of the slave on the wire.
        """
        registers, reference = self._master.registers, self.reference
        others = [Station(slave.address) for slave in self.followers]
        registers.exchange([place.write(OFFSET, bytes(12))])
        own, *times = registers.exchange(
            [
                place.read(SYSTEM_TIME, reference.dc_bits // 8),
                *(station.read(SYSTEM_TIME, 8) for station in others[:_ASKED]),
            ]
        )
        wanted = time.time_ns() - _EPOCH_NS
        for slave, answer in zip(self.followers, times, strict=False):
            if answer.wkc and slave.dc_bits >= reference.dc_bits:
                wanted = number(answer.data) - slave.dc_delay_ns
                break
        offset = (wanted - number(own.data)) % (1 << reference.dc_bits)
        registers.exchange(
            [
                place.write(OFFSET, struct.pack("<QI", offset, 0)),
                place.write(SPEED_START, struct.pack("<H", SPEED_START_DEFAULT)),
            ]
        )

    def rejoin(self, positions: Iterable[int], shared: SharedMemory) -> Steps[dict[int, str]]:
        """Brings restarted clocks in step again, and starts their SYNC signals.

        Slaves that are not optional are at their old places, so the delays from the start are still
        right. If there are optional slaves among them, delays are measured again.

        Returns:
            By position, why a clock does not come in step, or why SYNC signals do not start.
        """
        chosen = [slave for slave in self._clocks if slave.position in set(positions)]
        failed: dict[int, str] = {}
        yield from self._measure_again(chosen, shared)
        for slave in chosen:
            if slave is not self.reference and not self._set_time(slave):
                failed[slave.position] = (
                    f"its clock cannot be set: no answer from it or from the reference clock, "
                    f"{self.reference.label}"
                )
            yield
        # Only slaves with SYNC signals must wait: the others may come in step while they are in OP.
        waiting = {slave.position for slave in chosen if self.sync_signals.has(slave.position)}
        waiting -= set(failed)
        patience = self._config.dc.timeout
        deadline = time.monotonic() + patience.seconds
        while (late := self._out_of_step(waiting, shared)) and time.monotonic() < deadline:
            yield
        why = (
            f"its clock does not come in step with that of {self.reference.label} within {patience}"
        )
        failed |= dict.fromkeys(late, why)
        failed |= yield from self.sync_signals.start(shared, waiting - late)
        return failed

    def _out_of_step(self, positions: set[int], shared: SharedMemory) -> set[int]:
        """Returns the slaves whose clocks are not in step; all while the cycle is not locked."""
        if not positions or shared.health.dc_state != DcState.LOCKED:
            return positions
        limit = _RING_OPEN_NS if shared.health.ring == Ring.OPEN else IN_STEP_NS
        differences = self.differences() | {self.reference.position: 0}
        return {p for p in positions if abs(differences.get(p, limit + 1)) > limit}

    def _set_time(self, slave: Slave) -> bool:
        """Sets a clock by the reference clock; returns False without an answer from both.

        Both clocks are read in the same frame.
        """
        registers = self._master.registers
        at, size = Station(slave.address), slave.dc_bits // 8
        registers.exchange([at.write(OFFSET, struct.pack("<QI", 0, slave.dc_delay_ns))])
        reference = Station(self.reference.address).read(SYSTEM_TIME, self.reference.dc_bits // 8)
        now, own = registers.exchange([reference, at.read(SYSTEM_TIME, size)])
        if not (now.wkc and own.wkc):
            return False
        offset = (number(now.data) + slave.dc_delay_ns - number(own.data)) % (1 << slave.dc_bits)
        registers.exchange(
            [
                at.write(OFFSET, struct.pack("<QI", offset, slave.dc_delay_ns)),
                at.write(SPEED_START, struct.pack("<H", SPEED_START_DEFAULT)),
            ]
        )
        return True
