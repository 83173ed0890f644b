"""`package.order`: generated classes first, then those that the user has put into the folder.

The file must name exactly what is in its folder. Modelica tools write it, too, so a changed one
is no conflict: its order of the user's classes is taken over.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

from .folder import Folder, Tree

NAME = "package.order"
_PACKAGE = "package.mo"
_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


def merge(tree: Tree, folder: Folder, foreign: Iterable[str]) -> tuple[dict[str, bytes], list[str]]:
    """The files with every `package.order` completed.

    Args:
        tree: The generated files.
        folder: What is there now.
        foreign: Files of the user in it.

    Returns:
        The files, and what in the folder has the name of a generated class.
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
    """Folder, name and place of the class that a file makes there; no name if it makes none."""
    folder, _, file = path.rpartition("/")
    if file == _PACKAGE:
        parent, _, name = folder.rpartition("/")
        item = folder
    else:
        parent, item = folder, path
        name = file.removesuffix(".mo") if file.endswith(".mo") else ""
    return parent, name if _IDENTIFIER.fullmatch(name) else "", item
