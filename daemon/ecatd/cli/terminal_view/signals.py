"""The list of signals: name, value, unit, and what the value was."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Any

from rich.segment import Segment
from rich.style import Style
from textual.geometry import Size
from textual.scroll_view import ScrollView
from textual.strip import Strip

from .sparkline import Range, sparkline

_KEPT = 600
"""Rows that are kept: a minute."""
_PLAIN, _DIM, _LINE = Style(), Style(dim=True), Style(color="cyan")


class Signals(ScrollView, can_focus=True):
    """Draws only the lines that are seen, so hundreds of signals cost no more than twenty."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self._names: list[tuple[str, str]] = []  # name and unit
        self._last: list[float | None] = []
        self._courses: list[deque[Range]] = []
        self._shown: list[int] = []
        self._filter = ""
        self._message = "Waiting for values…"

    def begin(self, signals: Sequence[Any], labels: dict[tuple[int, str], str], why: str) -> None:
        """Another list of signals.

        Args:
            signals: As a stream has them.
            labels: Their names for people, by position of the slave and address.
            why: Why there are none.
        """
        if not signals and self._names:
            self._message = why  # values of before stay until others come
            return
        self._names = [
            (labels.get((s["slave"], s["address"]), s["name"]), s["unit"]) for s in signals
        ]
        self._last = [None] * len(signals)
        self._courses = [deque(maxlen=_KEPT) for _ in signals]
        self._message = why or ("No signals" if not signals else "")
        self._choose()

    def add(self, values: Sequence[Sequence[float | None]]) -> None:
        """A row of a stream."""
        if len(values) != len(self._courses):
            return
        for place, (low, mean, high, count) in enumerate(values):
            known = bool(count) and low is not None and high is not None
            self._courses[place].append((low, high) if known else None)  # type: ignore[arg-type]
            self._last[place] = mean
        self.refresh()

    def filter(self, text: str) -> None:
        """Shows only signals whose names contain a text."""
        self._filter = text.casefold()
        self._choose()

    def _choose(self) -> None:
        self._shown = [
            place for place, (name, _) in enumerate(self._names) if self._filter in name.casefold()
        ]
        self.virtual_size = Size(0, len(self._shown))
        self.refresh()

    def render_line(self, y: int) -> Strip:
        """One line: name, value, unit, course."""
        width = self.size.width
        number = y + self.scroll_offset.y
        if number >= len(self._shown):
            text = self._message if not y else ""
            if not y and self._names and not self._shown:
                text = "No signal has this in its name"
            return Strip([Segment(text[:width].ljust(width), _DIM)])
        place = self._shown[number]
        name, unit = self._names[place]
        value = self._last[place]
        shown = "–" if value is None else f"{value:.7g}"
        room = max(12, min(44, width - 42))
        unit_room = 6
        graph = max(0, width - room - 13 - unit_room - 2)
        return Strip(
            [
                Segment((name if len(name) <= room else f"{name[: room - 1]}…").ljust(room)),
                Segment(f"{shown[:12]:>13} ", Style(bold=True)),
                Segment(unit[:unit_room].ljust(unit_room), _DIM),
                Segment(sparkline(self._courses[place], graph), _LINE),
            ]
        ).adjust_cell_length(width)
