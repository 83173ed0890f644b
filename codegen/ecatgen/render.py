"""Renders the intermediate representation, with one short template for each kind of file."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from pathlib import Path

from jinja2 import (
    ChoiceLoader,
    FileSystemLoader,
    PackageLoader,
    PrefixLoader,
    TemplateNotFound,
    TemplateSyntaxError,
)

from ecatd.base.errors import ConfigError
from ecatd.base.files import read_text

from . import text
from .environment import CheckedEnvironment
from .ir import Library

OURS = "ecatgen"
"""The folder name with which a template of the user includes a built-in template."""

FILTERS: dict[str, Callable[..., text.Code]] = {
    "string": text.modelica_string,
    "html": text.modelica_html,
    "integer": text.modelica_integer,
    "c_string": text.c_string,
    "c_comment": text.c_comment,
    "identifier": text.identifier,
    "modification": text.modification,
}


@cache
def _environment(folders: tuple[Path, ...] = ()) -> CheckedEnvironment:
    ours = PackageLoader("ecatgen", "templates")
    loader = ChoiceLoader(
        [*(FileSystemLoader(folder) for folder in folders), ours, PrefixLoader({OURS: ours})]
    )
    environment = CheckedEnvironment(loader, text.Language.DOCUMENTATION, FILTERS)
    _check(folders, ours.list_templates())
    return environment


def _check(folders: Iterable[Path], known: Sequence[str]) -> None:
    """Checks that the templates of the user are readable and that each replaces a built-in one.

    Raises:
        ConfigError: A folder does not exist, a file cannot be read, or a name may be misspelt.
    """
    for folder in folders:
        if not folder.is_dir():
            raise ConfigError(f"{folder}: this is not a folder; give a folder with *.j2 files")
        for file in sorted(folder.rglob("*.j2")):
            if file.relative_to(folder).as_posix() not in known:
                raise ConfigError(
                    f"{file}: there is no template of this name to replace; there are "
                    f"{', '.join(known)}"
                )
            read_text(file)


def render(library: Library, templates: Iterable[Path] = ()) -> dict[str, bytes]:
    """Renders the files of the package, by their path in it.

    Args:
        library: The intermediate representation.
        templates: Folders of the user; a file there replaces the built-in template of its name.

    Raises:
        ConfigError: A template of the user is wrong.
    """
    environment = _environment(tuple(templates))

    def write(template: str, **values: object) -> bytes:
        try:
            return environment.get_template(template).render(library=library, **values).encode()
        except Exception as error:
            if not templates:
                raise
            raise ConfigError(_description(template, error)) from error

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
    if library.drives:
        files["Drives/package.mo"] = write("drives.mo.j2")
        files["Drives/package.order"] = write("drives.order.j2")
    files |= {
        f"Drives/{drive.name}.mo": write("drive.mo.j2", drive=drive) for drive in library.drives
    }
    if library.channels:
        files["Channels/package.mo"] = write("channels.mo.j2")
        files["Channels/package.order"] = write("channels.order.j2")
    files |= {
        f"Channels/{item.name}.mo": write("channel_block.mo.j2", item=item)
        for item in library.channels
    }
    return files


def _description(template: str, error: Exception) -> str:
    """Returns file, line and reason of an error in a template of the user."""
    reason = str(error) or type(error).__name__
    if isinstance(error, TemplateSyntaxError):
        return f"{error.filename or template}:{error.lineno}: {error.message}"
    if isinstance(error, TemplateNotFound):
        reason = (
            f"there is no template '{error.name}' to include; built-in ones begin with '{OURS}/'"
        )
    frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename.endswith(".j2")]
    where = f"{frames[-1].filename}:{frames[-1].lineno}" if frames else template
    return f"{where}: {reason}"
