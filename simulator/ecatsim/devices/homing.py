"""Homing (CiA 402-2): finds a reference and gives it the position of the home offset 0x607C.

| method | reference |
|---|---|
| 1, 2 | first index pulse inside the negative or the positive limit switch |
| 17, 18 | edge of the negative or the positive limit switch |
| 33, 34 | next index pulse in negative or positive direction |
| 35, 37 | the position at the start |
"""

from __future__ import annotations

import math
from enum import Enum, auto

from .axis import NEGATIVE_LIMIT, POSITIVE_LIMIT, Axis
from .modes import BIT_12, BIT_13, HALT, NEW_SET_POINT, TARGET_REACHED, Operation, Values

METHODS = (1, 2, 17, 18, 33, 34, 35, 37)
_ON_SWITCH = (1, 2, 17, 18)
_WITH_INDEX = (1, 2, 33, 34)
_HERE = (35, 37)


class _Phase(Enum):
    """The phase of homing."""

    IDLE = auto()  # not started, or interrupted
    TO_SWITCH = auto()
    OFF_SWITCH = auto()
    TO_INDEX = auto()
    STOPPING = auto()  # the reference is found
    DONE = auto()
    FAILED = auto()


class Homing(Operation):
    """Homing (6). Bit 4 of the control word starts it with its rising edge and must stay set."""

    def __init__(self, objects: Values, axis: Axis) -> None:
        super().__init__(objects, axis)
        self._phase = _Phase.IDLE
        self._method = 0
        self._started = False
        self._last = 0.0

    def start(self) -> None:
        """Brakes to standstill and waits for the start by bit 4."""
        super().start()
        self._phase, self._started = _Phase.IDLE, False

    def resume(self) -> None:
        """Returns to the idle phase: after a halt, the master must start homing again."""
        self.start()

    def command(self, word: int, elapsed: float) -> None:
        """Moves as the phase and the method require."""
        wanted = bool(word & NEW_SET_POINT)
        if wanted and not self._started:
            self._begin()
        elif not wanted and self._moving:
            self._phase = _Phase.IDLE
        self._started = wanted
        self._advance()
        self._ramp(self._speed(), self._objects[0x609A, 0], elapsed)
        # Limit switches do not hold the axis here: homing searches for them.
        self._axis.command_speed(self._reference, guarded=False)
        self._last = self._axis.machine

    def status(self, word: int, elapsed: float) -> int:
        """Returns bits 13, 12 and 10 of the status word: error, attained, target reached."""
        still = TARGET_REACHED * self._stands
        if word & HALT or self._phase is _Phase.IDLE:
            return still
        if self._phase is _Phase.FAILED:
            return BIT_13 | still
        if self._phase is _Phase.DONE:
            return BIT_12 | TARGET_REACHED
        return BIT_12 if self._phase is _Phase.STOPPING else 0

    @property
    def _stands(self) -> bool:
        return abs(self._axis.speed) <= self._objects[0x606F, 0]

    @property
    def _moving(self) -> bool:
        return self._phase in (_Phase.TO_SWITCH, _Phase.OFF_SWITCH, _Phase.TO_INDEX)

    def _begin(self) -> None:
        axis, self._method = self._axis, self._objects[0x6098, 0]
        self._last = axis.machine
        if self._method in _HERE:
            self._found(axis.machine)
        elif self._method in (33, 34):
            self._phase = _Phase.TO_INDEX
        elif self._method in _ON_SWITCH and self._edge is not None:
            self._phase = _Phase.OFF_SWITCH if self._on_switch else _Phase.TO_SWITCH
        else:
            self._phase = _Phase.FAILED  # the method is unknown, or the axis has no such switch

    @property
    def _direction(self) -> int:
        """Direction of the search; the axis leaves a switch in the other direction."""
        return -1 if self._method in (1, 17, 33) else 1

    @property
    def _edge(self) -> float | None:
        """Position of the edge of the limit switch, in machine coordinates."""
        switches = self._axis.switches
        turns = switches.negative if self._direction < 0 else switches.positive
        return None if turns is None else turns * self._axis.encoder

    @property
    def _on_switch(self) -> bool:
        bit = NEGATIVE_LIMIT if self._direction < 0 else POSITIVE_LIMIT
        return bool(self._axis.inputs & bit)

    def _advance(self) -> None:
        if self._phase is _Phase.TO_SWITCH and self._on_switch:
            self._phase = _Phase.OFF_SWITCH
        elif self._phase is _Phase.OFF_SWITCH and not self._on_switch:
            if self._method in _WITH_INDEX:
                self._phase = _Phase.TO_INDEX
                self._last = self._edge or 0.0
            else:
                self._found(self._edge or 0.0)
        if self._phase is _Phase.TO_INDEX:
            index = self._index_passed()
            if index is not None:
                self._found(index)
        if self._phase is _Phase.STOPPING and self._reference == 0.0 and self._stands:
            self._phase = _Phase.DONE

    def _index_passed(self) -> float | None:
        """Returns the first index pulse between the last position and this one, or None."""
        turn, here, last = self._axis.encoder, self._axis.machine, self._last
        pulse = (math.floor(last / turn) + 1 if here > last else math.ceil(last / turn) - 1) * turn
        return pulse if min(last, here) <= pulse <= max(last, here) else None

    def _found(self, reference: float) -> None:
        self._axis.shift = self._objects[0x607C, 0] - reference
        self._phase = _Phase.STOPPING

    def _speed(self) -> float:
        """Returns the target speed of the phase."""
        search, zero = self._objects[0x6099, 1], self._objects[0x6099, 2]
        if self._phase is _Phase.TO_SWITCH:
            return self._direction * search
        if self._phase is _Phase.OFF_SWITCH:
            return -self._direction * zero
        if self._phase is _Phase.TO_INDEX:
            return (-self._direction if self._method in _ON_SWITCH else self._direction) * zero
        return 0.0
