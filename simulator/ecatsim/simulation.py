"""Runs a rig on an interface: one loop handles bus events and makes the steps of the devices."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from ecatd.base.errors import StateError, UsageError
from ecatd.base.files import open_new

from .esc import Segment
from .faults import Faults
from .rig import Rig
from .slave.device import Device
from .slave.mailbox import MailboxMode

STEP_TIMES_US = range(1000, 10_001)
"""Times between two steps that a simulation can have, in µs."""

_MAX_LAG = 0.1
_CARRIER_PERIOD = 0.02


@dataclass(slots=True)
class _Place:
    """The state of one position on the wire.

    Attributes:
        original: The device that the rig has there.
        at: Offsets of its process data in the output image and the input image of the segment.
        room: Bytes reserved in these images, for outputs and inputs.
        due: Time of the next step of its device, CLOCK_MONOTONIC in seconds.
        on: Whether it has power.
        eeprom: The original SII image, once a fault has changed it.
        next_eeprom: The SII image for the next power-on, or None.
    """

    original: Device
    at: tuple[int, int] = (0, 0)
    room: tuple[int, int] = (0, 0)
    due: float = 0.0
    on: bool = True
    eeprom: bytes | None = None
    next_eeprom: bytes | None = None


class Simulation:
    """The simulation of a rig on a segment.

    A thread in C answers frames. Everything else happens in the thread that calls `run`: it handles
    requests of the master as soon as they come, and makes steps of plants and devices at regular
    times. A loop that is late leaves steps out; devices and plants get the time and compensate for
    it themselves.

    Another thread that uses devices must hold `lock`; the methods of `faults` do so.

    Args:
        rig: The rig to simulate.
        trace: A CSV file to record to, or None.
        step_time_us: Time between two steps in µs, one of `STEP_TIMES_US`. A step costs processor
            time, so steps more often than the cycles of the bus are of little use.

    Attributes:
        rig: The rig.
        segment: The slave controllers.
        lock: Held while devices and plants are used.
        after_step: Functions that are called after each step of plants and devices.
        faults: Adds and lists faults, with one method for each kind.
    """

    def __init__(self, rig: Rig, trace: Path | None = None, step_time_us: int = 1000) -> None:
        self.rig = rig
        self._step_time = step_time_us / 1e6
        self.segment = Segment()
        self.lock = threading.RLock()
        self.after_step: list[Callable[[], None]] = []
        self._outputs = b""  # of all slaves, at the last step
        self._trace_file: IO[str] | None = None
        self._places = [_Place(device) for device in rig.devices]
        wiring = rig.wiring()
        for device, place, parent in zip(rig.devices, self._places, wiring.parents, strict=True):
            self._make_room(place, device)
            device.attach(self.segment, *place.at)
            if parent:
                self.segment.connect(device.position, *parent)
        if wiring.ring_end:
            self.segment.close_ring(*wiring.ring_end)
        for device in rig.exchanged:
            self.segment.exchange_ports(device.position)
        self.faults = Faults(self)
        for fault in rig.faults:
            self.faults.add(fault)
        if trace is not None:
            self._open_trace(trace)

    def _open_trace(self, path: Path) -> None:
        if self.rig.trace is None:
            raise UsageError(f"rig {self.rig.name} has nothing to trace")
        try:
            self._trace_file = os.fdopen(open_new(path, force=True), "w", encoding="ascii")
            if path.is_file():
                self._trace_file.truncate(0)
        except OSError as error:
            raise UsageError(f"cannot write '{path}': {error.strerror}") from error
        self._trace_file.write(",".join(("time_ns", *self.rig.trace.columns)) + "\n")

    def close(self) -> None:
        """Stops the segment, closes plants and the trace file."""
        self.segment.close()
        for plant in self.rig.plants:
            close = getattr(plant, "close", None)
            if close is not None:
                close()
        if self._trace_file:
            self._trace_file.close()

    def run(self, stop: Callable[[], bool]) -> None:
        """Simulates until `stop` returns true, which is called at least once for each step."""
        due = look = time.monotonic()
        while not stop():
            events = self.segment.wait(max(0.0, due - time.monotonic()))
            now = time.monotonic()
            with self.lock:
                for position, event in events:
                    if self._places[position].on:
                        self.rig.devices[position].handle(event, now)
            now = time.monotonic()
            if now >= due:
                self.step()
                if now >= look:
                    self.segment.follow_carriers()
                    look = now + _CARRIER_PERIOD
                for call in self.after_step:
                    call()
                due += self._step_time
                if now - due > _MAX_LAG:
                    due = now

    def step(self) -> None:
        """Makes one step of faults, plants and devices."""
        with self.lock:
            self.faults.run()
            self._step()

    def _step(self) -> None:
        now_ns = time.monotonic_ns()
        now = now_ns / 1e9
        self.segment.get_outputs(now_ns)
        outputs = bytes(self.segment.outputs)
        same, self._outputs = outputs == self._outputs, outputs
        powered = [(d, p) for d, p in zip(self.rig.devices, self._places, strict=True) if p.on]
        for device, _ in powered:
            if not (same and device.sleeps):
                device.take_outputs()
        for plant in self.rig.plants:
            plant(now)
        for bus in self.rig.can:
            bus.run(now)
        for device, place in powered:
            if now >= place.due and not device.sleeps:
                device.run(now)
                place.due = max(place.due + device.period, now - device.period)
        self.segment.put_inputs()
        if self._trace_file and self.rig.trace:
            values = ",".join(f"{value:.10g}" for value in self.rig.trace.values())
            self._trace_file.write(f"{now_ns},{values}\n")

    # --- for faults ----------------------------------------------------------------------------

    @property
    def devices(self) -> list[Device]:
        """All devices by position, including those that have replaced others."""
        return self.rig.devices

    def is_on(self, position: int) -> bool:
        """Whether a slave has power."""
        return self._places[position].on

    def powered(self, position: int) -> Device:
        """Returns the device of a slave that has power.

        Raises:
            StateError: The slave has no power.
        """
        if not self.is_on(position):
            raise StateError(f"slave {position} has no power: `power-on` comes first")
        return self.rig.devices[position]

    def conditions(self, position: int) -> list[str]:
        """Returns the conditions of a slave that faults have caused, in words."""
        place, device = self._places[position], self.rig.devices[position]
        mode = device.mailbox_fault.mode
        refused = self.segment.refused_fmmus(position)
        numbers = ", ".join(map(str, refused))
        found = {
            "no power": not place.on,
            "swapped": device is not place.original,
            f"mailbox {mode}": mode != MailboxMode.NONE,
            "EEPROM changed": place.eeprom not in (None, self.segment.sii(position)),
            f"FMMUs {numbers} are too close to each other to map bits": bool(refused),
        }
        return [text for text, applies in found.items() if applies]

    def power(self, position: int, on: bool) -> None:
        """Switches the power of a slave on or off; does nothing if it already is."""
        place, device = self._places[position], self.rig.devices[position]
        with self.lock:
            if place.on == on:
                return
            if on and place.next_eeprom is not None:
                self.segment.set_eeprom(position, place.next_eeprom)
                place.next_eeprom = None
            if not on:
                device.reset()  # stops whatever its outputs drive
            self.segment.power(position, on)
            if on:
                device.reset()
            place.on = on

    def swap(self, position: int, device: Device | None) -> None:
        """Replaces a slave by another device, or (None) by the first one again.

        The device starts as at power-on. Wires, waveforms and plants stay with the first one.
        """
        place = self._places[position]
        with self.lock:
            old = self.rig.devices[position]
            new = place.original if device is None else device
            self._make_room(place, new)
            new.attach(self.segment, *place.at, place=position)  # if this fails, the old one stays
            self.rig.devices[position] = new
            if old is not new:
                old.detach()
            place.eeprom = place.next_eeprom = None
            place.on = True

    def original_eeprom(self, position: int) -> bytes:
        """Returns the SII image of a slave as it was before a fault first changed it."""
        place = self._places[position]
        if place.eeprom is None:
            place.eeprom = self.segment.sii(position)
        return place.eeprom

    def eeprom_at_power_on(self, position: int, image: bytes) -> None:
        """Gives a slave another SII image, which it gets at its next power-on."""
        self._places[position].next_eeprom = image

    def _make_room(self, place: _Place, device: Device) -> None:
        """Reserves a place in the process images of the segment for a device."""
        room = max(device.room[0], place.room[0]), max(device.room[1], place.room[1])
        if room == place.room:
            return
        place.room = room
        place.at = (len(self.segment.outputs), len(self.segment.inputs))
        inputs = bytes(self.segment.inputs)
        self.segment.make_images(place.at[0] + place.room[0], place.at[1] + place.room[1])
        self.segment.inputs[: len(inputs)] = inputs
