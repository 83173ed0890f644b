"""Renders the files of an FMU that depend on the bus, with one template for each file."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from jinja2 import PackageLoader

from .. import text
from ..environment import CheckedEnvironment
from .ir import Fmu

_FILTERS: dict[str, Callable[..., text.Code]] = {
    "xml": text.xml,
    "attributes": text.xml_attributes,
    "text": text.table_text,
    "word": text.table_word,
}


@cache
def _environment() -> CheckedEnvironment:
    loader = PackageLoader("ecatgen.fmu", "templates")
    return CheckedEnvironment(loader, text.Language.XML, _FILTERS)


def render(fmu: Fmu) -> dict[str, bytes]:
    """Returns the files that differ between FMUs, by their path in the FMU."""
    files = {
        "modelDescription.xml": f"fmi{fmu.fmi}.xml.j2",
        "resources/plant.txt": "plant.txt.j2",
        "documentation/index.html": "index.html.j2",
    }
    if fmu.fmi == 3:
        files["sources/buildDescription.xml"] = "build.xml.j2"
        files["terminalsAndIcons/terminalsAndIcons.xml"] = "terminals.xml.j2"
    if fmu.bus_terminals:
        files["extra/org.fmi-standard.fmi-ls-bus/fmi-ls-manifest.xml"] = "manifest.xml.j2"
    return {
        path: _environment().get_template(template).render(fmu=fmu).encode()
        for path, template in files.items()
    }
