"""Renders the files of an FMU that depend on the bus, with one template for each file."""

from __future__ import annotations

import html

from jinja2 import Environment, PackageLoader, StrictUndefined

from ..text import one_line
from .ir import Attributes, Fmu


def _escaped(text: str) -> str:
    return html.escape(one_line(text))


def _attributes(attributes: Attributes) -> str:
    return "".join(f' {name}="{_escaped(value)}"' for name, value in attributes)


def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("ecatgen.fmu", "templates"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,  # the filters below escape for the language of each place
    )
    environment.filters |= {"xml": _escaped, "attributes": _attributes, "line": one_line}
    return environment


def render(fmu: Fmu) -> dict[str, bytes]:
    """Returns the files that differ between FMUs, by their path in the FMU."""
    environment = _environment()
    files = {
        "modelDescription.xml": f"fmi{fmu.fmi}.xml.j2",
        "resources/plant.txt": "plant.txt.j2",
        "documentation/index.html": "index.html.j2",
    }
    if fmu.fmi == 3:
        files["sources/buildDescription.xml"] = "build.xml.j2"
        files["terminalsAndIcons/terminalsAndIcons.xml"] = "terminals.xml.j2"
    return {
        path: environment.get_template(template).render(fmu=fmu).encode()
        for path, template in files.items()
    }
