"""Completes `package.order`: generated classes first, then the classes of the user in the folder.

The file must name exactly the classes in its folder. Modelica tools write this file, too.
Therefore a changed file is not a conflict, and the order of the user's classes in it is kept.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

from .folder import Folder, Tree

NAME = "package.order"
_PACKAGE = "package.mo"
_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


def merge(tree: Tree, folder: Folder, foreign: Iterable[str]) -> tuple[dict[str, bytes], list[str]]:
    """Adds the classes of the user to every `package.order`.

    Args:
        tree: The generated files.
        folder: The folder as it is now.
        foreign: Paths of the user's files in it.

    Returns:
        The files, and the paths of the user's items that have the name of a generated class.
    """
    classes: dict[str, dict[str, str]] = {}
    for path in sorted(foreign):
        parent, name, item = _class(path)
        if name and f"{item}/{_PACKAGE}" not in tree:
            classes.setdefault(parent, {})[name] = item
    result, clashes = dict(tree), []
    for path in tree:
        parent, _, file = path.rpartition("/")
        if file != NAME or parent not in classes:
            continue
        generated = tree[path].decode().split()
        mine = classes[parent]
        clashes += [item for name, item in mine.items() if name in generated]
        before = (folder.data(path) or b"").decode("utf-8", "replace").split()
        known = [name for name in dict.fromkeys(before) if name in mine]
        names = [*generated, *known, *sorted(mine.keys() - set(known))]
        result[path] = "".join(f"{name}\n" for name in dict.fromkeys(names)).encode()
    return result, clashes


def _class(path: str) -> tuple[str, str, str]:
    """Returns the parent folder, name and path of the class in a file; name "" means no class."""
    folder, _, file = path.rpartition("/")
    if file == _PACKAGE:
        parent, _, name = folder.rpartition("/")
        item = folder
    else:
        parent, item = folder, path
        name = file.removesuffix(".mo") if file.endswith(".mo") else ""
    return parent, name if _IDENTIFIER.fullmatch(name) else "", item
