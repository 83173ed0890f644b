"""Draws a figure from its description as data."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import reduce
from pathlib import Path
from typing import Any, Literal

COLORS = {
    "ours": "#1f6fb4",
    "ours_too": "#7fb3dd",
    "bare": "#8c8c8c",
    "bare_too": "#c4c4c4",
    "orange": "#e08e2b",
    "green": "#5b9a5b",
    "limit": "#c0392b",
}
_STYLE: Any = {"svg.fonttype": "none", "svg.hashsalt": "ecatd", "font.size": 9}


def item(case: Any, path: str) -> Any:
    """Returns the value at a path such as "loops.engine.p50" in a result, None if there is none."""
    return reduce(lambda found, key: found.get(key) if found else None, path.split("."), case)


@dataclass(frozen=True)
class Series:
    """A series of values in a diagram.

    The values come from `cases`, a list of results. `y`, `tail`, `quartiles` and `dash` are paths
    in a result, as in `item`.

    Attributes:
        cases: The results.
        x: Key of the x value in a result.
        y: Path of the y value.
        label: Text of the legend.
        color: A name in `COLORS`, or a colour of matplotlib; "" lets matplotlib choose.
        style: Style of lines and marks, as a format string of matplotlib.
        tail: Path of a larger value, to which a whisker goes.
        quartiles: Path of a pair of quartiles, between which a whisker goes.
        dash: Path of a value that is drawn as a dash.
        alpha: Opacity, from 0 to 1.
    """

    cases: Sequence[dict[str, Any]]
    x: str
    y: str
    label: str = ""
    color: str = "ours"
    style: str = "o-"
    tail: str = ""
    quartiles: str = ""
    dash: str = ""
    alpha: float = 1.0


@dataclass(frozen=True)
class Panel:
    """One diagram.

    Attributes:
        title: Title of the diagram.
        x: Label of the x axis.
        y: Label of the y axis.
        series: The series that are drawn.
        kind: "lines" over numbers, or a group of "bars" or "points" for each x.
        unit: All y values are divided by this number.
        levels: Colours and y values of horizontal lines across the diagram.
        limits: y value of a dashed red line at a group, by the x of the group.
        band: Two y values; the band between them is shaded.
        log: Whether x doubles from one tick to the next.
        largest: The x axis ends at this value or later.
        legend: Position of the legend, None for no legend.
        columns: Number of columns of the legend.
        room: Factor by which the y axis is longer than needed, to make room for the legend.
        width: Share of the width of a group that bars or points take.
    """

    title: str
    x: str
    y: str
    series: Sequence[Series]
    kind: Literal["lines", "bars", "points"] = "lines"
    unit: float = 1.0
    levels: Sequence[tuple[str, float]] = ()
    limits: dict[Any, float] = field(default_factory=dict)
    band: Sequence[float] = ()
    log: bool = False
    largest: float = 0.0
    legend: str | None = "best"
    columns: int = 1
    room: float = 1.0
    width: float = 0.84

    def draw(self, axes: Any) -> None:
        """Draws the diagram on axes of matplotlib."""
        groups = list(dict.fromkeys(case[s.x] for s in self.series for case in s.cases))
        for number, series in enumerate(self.series):
            if self.kind == "lines":
                self._line(axes, series)
            else:
                self._group(axes, series, number, groups)
        for color, level in self.levels:
            axes.axhline(level, color=COLORS[color], lw=0.8)
        for x, limit in self.limits.items():
            at = groups.index(x)
            axes.hlines(limit, at - 0.42, at + 0.42, color=COLORS["limit"], lw=1.5, ls="--")
        if self.band:
            axes.axhspan(*self.band, color=COLORS["ours"], alpha=0.12, lw=0)
        axes.set(title=self.title, xlabel=self.x, ylabel=self.y)
        self._scale(axes, groups)
        if self.legend and any(series.label for series in self.series):
            axes.legend(frameon=False, fontsize=8, loc=self.legend, ncols=self.columns)

    def _scale(self, axes: Any, groups: Sequence[Any]) -> None:
        if self.log:
            axes.set_xscale("log", base=2)
        if self.log or self.kind != "lines":
            names = [textwrap.fill(str(group), 22) for group in groups]
            axes.set_xticks(groups if self.log else range(len(groups)), names)
        else:
            axes.set_xlim(0, max(self.largest, 1.05 * max(groups, default=1)))
        if self.kind != "points":
            axes.set_ylim(0, self.room * axes.get_ylim()[1])

    def _values(self, series: Series, path: str) -> list[float]:
        return [item(case, path) / self.unit for case in self._present(series)]

    @staticmethod
    def _present(series: Series) -> list[dict[str, Any]]:
        return [case for case in series.cases if item(case, series.y) is not None]

    def _line(self, axes: Any, series: Series) -> None:
        x = [case[series.x] for case in self._present(series)]
        color = COLORS.get(series.color, series.color or None)
        y = self._values(series, series.y)
        axes.plot(x, y, series.style, color=color, label=series.label, ms=4)

    def _group(self, axes: Any, series: Series, number: int, groups: Sequence[Any]) -> None:
        """Draws bars or points; those of one group lie beside each other."""
        cases, values = self._present(series), self._values(series, series.y)
        places: list[float] = []
        for k, case in enumerate(cases):
            same = [n for n, other in enumerate(cases) if other[series.x] == case[series.x]]
            order = (same.index(k) * len(self.series) + number + 0.5) / len(self.series) / len(same)
            places.append(groups.index(case[series.x]) + self.width * (order - 0.5))
        color = COLORS[series.color]
        whiskers = {"capsize": 2, "lw": 0.8, "fmt": "none", "ecolor": "#333"}
        if self.kind == "bars":
            width = 0.93 * self.width / len(self.series)
            label, alpha = series.label, series.alpha
            axes.bar(places, values, width, color=color, label=label, alpha=alpha)
        else:
            whiskers |= {
                "fmt": series.style,
                "color": color,
                "ecolor": color,
                "ms": 4,
                "label": series.label,
            }
        low = high = values
        if series.tail:
            high = self._values(series, series.tail)
        elif series.quartiles:
            pairs = [item(case, series.quartiles) for case in cases]
            low, high = ([pair[i] / self.unit for pair in pairs] for i in (0, 1))
        if series.tail or series.quartiles:
            down = [max(0.0, y - end) for y, end in zip(values, low, strict=True)]
            up = [max(0.0, end - y) for y, end in zip(values, high, strict=True)]
            axes.errorbar(places, values, [down, up], **whiskers)
        if series.dash:
            axes.plot(places, self._values(series, series.dash), "_", color=color, ms=8)


@dataclass(frozen=True)
class Figure:
    """Diagrams in rows.

    Attributes:
        rows: The diagrams.
        size: Width and height in inches.
    """

    rows: Sequence[Sequence[Panel]]
    size: tuple[float, float]

    def save(self, path: Path) -> None:
        """Draws the figure into a file."""
        import matplotlib as mpl

        mpl.use("Agg")
        import matplotlib.pyplot as plt

        with plt.rc_context(_STYLE):
            shape = len(self.rows), len(self.rows[0])
            figure, axes = plt.subplots(
                *shape, figsize=self.size, layout="constrained", squeeze=False
            )
            for row, panels in zip(axes, self.rows, strict=True):
                for place, panel in zip(row, panels, strict=True):
                    panel.draw(place)
            figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)
            plt.close(figure)
