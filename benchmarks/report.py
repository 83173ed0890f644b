"""Writes performance.md and its plots from the JSON of the benchmarks.

Each section is a template, `NAME/section.md.j2`: what it says, its tables, targets
(`target.Target`) and figure (`plot.Figure`), with the results of the benchmark as variables.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from jinja2 import ChainableUndefined, Environment, FileSystemLoader, StrictUndefined, Undefined

from ecatd.model.errors import UsageError

from .plot import Figure, Panel, Series
from .target import Target

SECTIONS = ("engine", "cores", "scale", "recovery", "requests", "client", "modelica", "simulator")
"""Names of the benchmarks, in the order of the page."""


class _Missing(ChainableUndefined, StrictUndefined):
    """What a result has not: `us` may write it, and nothing else."""


def _us(ns: float | Undefined) -> str:
    """Nanoseconds in microseconds."""
    return "–" if isinstance(ns, Undefined) else f"{ns / 1000:.1f}"


def _flat(items: Iterable[dict[str, Any]], key: str) -> list[dict[str, Any]]:
    """The items of the lists `key` of all items, each with what its owner has, too."""
    return [{**owner, **item} for owner in items for item in owner.get(key, ())]


def _ratio(case: dict[str, Any], key: str, sign: str = "") -> str:
    """A ratio with its quartiles."""
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
    """What a benchmark has found, in Markdown, and the figure in it."""
    figures: list[Figure] = []

    def figure(text: str, size: tuple[float, float], *rows: list[Panel]) -> str:
        figures.append(Figure(rows, size))
        return f"![{text}](performance/{name}.svg)"

    def target(*arguments: Any, **more: Any) -> str:
        return Target(*arguments, **more).row(result["machine"])

    template = _ENVIRONMENT.get_template(f"{name}/section.md.j2")
    text = template.render(result, figure=figure, target=target)
    text = re.sub(r"(?<=\S)\n *(?=[^\s|#-])(?!\d+\. )", " ", text)  # a paragraph is a line
    return re.sub(r"\n\n+", "\n\n", text).strip(), figures[0]


def write(out: Path) -> str:
    """Writes the page and the plots to a folder; returns what to tell the user.

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
