"""The list of signals: name, value, unit, and what the value was."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from rich.text import Text

from ecatd.base.sanitized_output import printable

from .lines import Column, Line, Lines
from .sparkline import STEPS, Range, gather, sparkline

_KEPT = 600
"""Rows that are kept: a minute."""
_DRAWN = 300
"""Rows that are drawn: half a minute."""


class Meaning(NamedTuple):
    """What people call an entry, and its values.

    Attributes:
        label: Its name.
        values: Names of values, by the physical value.
    """

    label: str
    values: Mapping[float, str]


class Signals(Lines):
    """Draws only the lines that are seen, so hundreds of signals cost no more than twenty."""

    def __init__(self, **settings: Any) -> None:
        columns = (
            Column("SIGNAL", 27, 46),
            Column("VALUE", 12, 16, right=True),
            Column("UNIT", 8, 20),
            Column("LAST 30 s", 16),
        )
        super().__init__(columns, "Waiting for values…", **settings)
        self._signals: Sequence[Any] = ()
        self._meanings: Sequence[Meaning] = ()
        self._last: list[float | None] = []
        self._courses: list[deque[Range]] = []
        self._added = 0  # rows
        self._shown: list[int] = []
        self._filter = ""

    def begin(
        self, signals: Sequence[Any], meanings: Mapping[tuple[int, str], Meaning], why: str
    ) -> None:
        """Another list of signals.

        Args:
            signals: As a stream has them.
            meanings: What they mean, by position of the slave and address.
            why: Why there are none.
        """
        if not signals and self._signals:
            self.empty = why  # values of before stay until others come
            return
        self._signals = signals
        self._meanings = [
            meanings.get((s["slave"], s["address"]), Meaning(printable(s["name"]), {}))
            for s in signals
        ]
        self._last = [None] * len(signals)
        self._courses = [deque(maxlen=_KEPT) for _ in signals]
        self.empty = why or "No signals"
        self._choose()

    def forget(self) -> None:
        """Shows nothing until another bus has signals."""
        self._signals = ()
        self.begin((), {}, "Waiting for values…")

    def add(self, values: Sequence[Sequence[float | None]]) -> None:
        """A row of a stream."""
        if len(values) != len(self._courses):
            return
        self._added += 1
        for place, (low, mean, high, count) in enumerate(values):
            known = bool(count) and low is not None and high is not None
            self._courses[place].append((low, high) if known else None)  # type: ignore[arg-type]
            self._last[place] = mean
        if self.is_on_screen:
            self.refresh()
            self.post_message(self.Moved())

    def filter(self, text: str) -> None:
        """Shows only signals whose names contain a text."""
        self._filter = text.casefold()
        self._choose()

    def _choose(self) -> None:
        self._shown = [
            place
            for place, meaning in enumerate(self._meanings)
            if self._filter in meaning.label.casefold()
        ]
        if self._meanings and not self._shown:
            self.empty = "No signal has this in its name"
        self.set_keys([str(self._signals[place]["name"]) for place in self._shown])

    def line(self, number: int) -> Line:
        """See `Lines`."""
        place = self._shown[number]
        meaning, value, course = self._meanings[place], self._last[place], self._courses[place]
        unit = printable(self._signals[place]["unit"])
        name = meaning.values.get(value, "") if value is not None else ""
        room = self.widths()[-1]
        return Line(
            "",
            (
                Text(meaning.label),
                Text("–" if value is None else f"{value:.7g}", "bold"),
                Text(name or unit, "dim"),
                Text(sparkline(self._steps(course, STEPS * room), room), "cyan"),
            ),
            self._describe(place, name or unit),
        )

    def _steps(self, course: Sequence[Range], count: int) -> list[Range]:
        """The newest rows in steps of equal length, which move on as wholes: nothing flickers."""
        if not count:
            return []
        size = max(1, round(_DRAWN / count))
        rows = list(course)
        ends = range(len(rows) - self._added % size, 0, -size)
        steps = [gather(rows[max(0, end - size) : end]) for end in ends[:count]]
        return [*reversed(steps), gather(rows[ends.start :])][-count:]

    def _describe(self, place: int, of: str) -> str:
        value, whole = self._last[place], gather(self._courses[place])
        text = f"{self._meanings[place].label} ({self._signals[place]['name']}): "
        if value is None or whole is None:
            return text + "there is no value, as the slave takes no part in the exchange"
        seconds = len(self._courses[place]) / 10
        low, high = (f"{each:.7g}" for each in whole)
        was = f"always {low}" if low == high else f"from {low} to {high}"
        return f"{text}{value:.7g} {of}".rstrip() + f"; {was} in the last {seconds:.0f} s"
