"""Touch probes (CiA 402-2, objects 0x60B8 to 0x60BD): the position at an edge, however fast.

The input of probe 1 is the home switch, that of probe 2 the positive limit switch. Either can take
the index pulse instead.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from .axis import Axis, wrapped
from .modes import Values

_FUNCTION, _STATUS, _POSITIONS = 0x60B8, 0x60B9, 0x60BA
_ENABLED, _CONTINUOUS, _INDEX = 0x01, 0x02, 0x04
_EDGES = ((0x10, 0x02), (0x20, 0x04))  # sampled at the positive and negative edge; is stored


class TouchProbes:
    """The touch probes of a drive.

    Args:
        objects: The objects of the drive.
        axis: Its axis.
        probes: How many of them it has.
        index: Whether they can take the index pulse.
    """

    def __init__(self, objects: Values, axis: Axis, probes: int = 2, index: bool = True) -> None:
        self._objects, self._axis = objects, axis
        self._probes, self._index = probes, index
        self._last = axis.machine

    def step(self) -> None:
        """Stores the positions of the edges since the last step."""
        function, status = self._objects[_FUNCTION, 0], self._objects[_STATUS, 0]
        if function or status:
            for number in range(self._probes):
                shift = 8 * number
                new = self._watch(number, function >> shift & 0xFF, status >> shift & 0xFF)
                status = status & ~(0xFF << shift) | new << shift
            self._objects[_STATUS, 0] = status
        self._last = self._axis.machine

    def _watch(self, number: int, function: int, status: int) -> int:
        """Follows one probe; returns its new status."""
        if not function & _ENABLED:
            return 0
        status |= _ENABLED
        for sampled, stored in _EDGES:
            if not function & sampled:
                status &= ~stored
        for negative, place in self._edges(number, bool(function & _INDEX)):
            sampled, stored = _EDGES[negative]
            if function & sampled and (function & _CONTINUOUS or not status & stored):
                position = wrapped(place + self._axis.shift)
                self._objects[_POSITIONS + 2 * number + negative, 0] = position
                status |= stored
        return status

    def _edges(self, number: int, index: bool) -> Iterator[tuple[bool, float]]:
        """Yields the edges since the last step: whether it is a negative one, and where."""
        axis, last, here = self._axis, self._last, self._axis.machine
        if last == here:
            return
        direction = 1 if here > last else -1
        if index and self._index:
            place = axis.pulse(last, direction)
            if (here - place) * direction >= 0:
                yield False, place
            return
        left, right = axis.home or (math.inf, math.inf)
        if number:
            turns = axis.switches.positive
            left, right = math.inf if turns is None else turns * axis.encoder, math.inf
        for place, rises in sorted(((left, 1), (right, -1)), reverse=direction < 0):
            if min(last, here) < place <= max(last, here):
                yield rises != direction, place
