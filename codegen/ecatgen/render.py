"""Writes the intermediate representation down, with one short template for each kind of file."""

from __future__ import annotations

from jinja2 import Environment, PackageLoader, StrictUndefined

from . import text
from .ir import Library


def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("ecatgen", "templates"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,  # the filters below escape for the language of each place
    )
    environment.filters |= {
        "string": text.modelica_string,
        "html": text.modelica_html,
        "integer": text.modelica_integer,
        "c_string": text.c_string,
        "c_comment": text.c_comment,
        "modification": text.modification,
    }
    return environment


def render(library: Library) -> dict[str, bytes]:
    """The files of the package, by their path in it."""
    environment = _environment()

    def write(template: str, **values: object) -> bytes:
        return environment.get_template(template).render(library=library, **values).encode()

    files = {
        "package.mo": write("package.mo.j2"),
        "package.order": write("package.order.j2"),
        "UsersGuide.mo": write("users_guide.mo.j2"),
        "Examples/package.mo": write("examples.mo.j2"),
        "Examples/package.order": write("examples.order.j2"),
        f"Resources/Source/{library.name}.h": write("calls.h.j2"),
    }
    files |= {f"{block.name}.mo": write("block.mo.j2", block=block) for block in library.blocks}
    files |= {
        f"Examples/{example.name}.mo": write("example.mo.j2", example=example)
        for example in library.examples
    }
    return files
