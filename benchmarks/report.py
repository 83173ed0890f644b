"""Writes performance.md and its plots from the JSON of the benchmarks.

Each section is a template, `NAME/section.md.j2`, with the results of the benchmark as variables. It
has text, tables, targets (`target.Target`) and a figure (`plot.Figure`).
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from jinja2 import ChainableUndefined, Environment, FileSystemLoader, StrictUndefined, Undefined

from ecatd.base.errors import UsageError

from .plot import Figure, Panel, Series
from .target import Target

SECTIONS = (
    *("engine", "cores", "settings", "scale", "recovery", "deaths"),
    *("can", "requests", "files", "live_view", "scope", "client", "modelica", "simulator"),
)
"""Names of the benchmarks, in the order of the page."""


class _Missing(ChainableUndefined, StrictUndefined):
    """A missing value of a result. The filter `us` writes it as a dash; any other use fails."""


def _us(ns: float | Undefined) -> str:
    """Returns nanoseconds as text in microseconds, and a dash for a missing value."""
    return "–" if isinstance(ns, Undefined) else f"{ns / 1000:.1f}"


def _flat(items: Iterable[dict[str, Any]], key: str) -> list[dict[str, Any]]:
    """Returns the elements of the list `key` of each item, merged with the item itself."""
    return [{**owner, **item} for owner in items for item in owner.get(key, ())]


def _ratio(case: dict[str, Any], key: str, sign: str = "") -> str:
    """Returns a ratio and its quartiles as text."""
    return "{:.2f}{} ({:.2f} to {:.2f})".format(case[key], sign, *case[f"{key}_quartiles"])


_ENVIRONMENT = Environment(
    loader=FileSystemLoader(Path(__file__).parent),
    undefined=_Missing,
    extensions=["jinja2.ext.do"],
    trim_blocks=True,
    lstrip_blocks=True,
    autoescape=False,  # it is Markdown
)
_ENVIRONMENT.filters |= {
    "digits": lambda value, count=0: f"{value:.{count}f}",
    "short": lambda value: f"{value:g}",
    "percent": lambda value, count=0: f"{value:.{count}%}",
    "us": _us,
    "pace": lambda rate: f"{rate / 1000:g} kHz" if rate else "free-running",
    "slaves": lambda count: f"{count} slave" + "s" * (count != 1),
    "flat": _flat,
    "ratio": _ratio,
}
_ENVIRONMENT.globals |= {"panel": Panel, "series": Series}


def section(name: str, result: dict[str, Any]) -> tuple[str, Figure]:
    """Returns the section of a benchmark in Markdown, and its figure."""
    figures: list[Figure] = []

    def figure(text: str, size: tuple[float, float], *rows: list[Panel]) -> str:
        figures.append(Figure(rows, size))
        return f"![{text}](performance/{name}.svg)"

    def target(*arguments: Any, **more: Any) -> str:
        return Target(*arguments, **more).row(result["machine"])

    template = _ENVIRONMENT.get_template(f"{name}/section.md.j2")
    text = template.render(result, figure=figure, target=target)
    text = re.sub(r"(?<=\S)\n *(?=[^\s|#-])(?!\d+\. )", " ", text)  # one line per paragraph
    return re.sub(r"\n\n+", "\n\n", text).strip(), figures[0]


def write(out: Path) -> str:
    """Writes the page and the plots to a folder.

    Returns:
        The text of all sections, to show to the user.

    Raises:
        UsageError: There are no results.
    """
    folder = out / "performance"
    files = {name: folder / f"{name}.json" for name in SECTIONS}
    results = {name: json.loads(file.read_text()) for name, file in files.items() if file.exists()}
    if not results:
        raise UsageError(f"there are no results in '{folder}': run without --report-only")
    texts = {}
    for name, result in results.items():
        texts[name], figure = section(name, result)
        figure.save(folder / f"{name}.svg")
    page = _ENVIRONMENT.get_template("page.md.j2").render(results=results, texts=texts)
    (out / "performance.md").write_text(page.rstrip() + "\n")
    return "\n\n".join(texts.values())
