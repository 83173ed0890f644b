"""Finds classes by name in folders with libraries, by the rules of the Modelica specification."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from pymoca.parser import ModelicaSyntaxError

from .syntax import Class, parse

BUILT_IN = frozenset({"Real", "Integer", "Boolean", "String", "ExternalObject", "StateSelect"})


class NoSuchClassError(LookupError):
    """The libraries do not have the class."""


@dataclass(frozen=True, slots=True)
class Found:
    """A class and its full name."""

    path: str
    definition: Class


class Libraries:
    """The classes of all libraries in some folders.

    If several folders have a library of the same name, the first folder is used.

    Args:
        folders: Folders with libraries. Each library is a folder or a file with its name.
    """

    def __init__(self, folders: Sequence[Path]) -> None:
        self._folders = folders
        self._classes: dict[str, Class | None] = {}

    def get(self, path: str) -> Found:
        """Returns a class by its full name.

        Raises:
            NoSuchClassError: There is no such class.
        """
        found = self._inside("", path.lstrip("."))
        if found is None:
            raise NoSuchClassError(f"there is no class {path}")
        return found

    def find(self, name: str, scope: str) -> Found | None:
        """Returns the class that a name in another class refers to, None for built-in types.

        Args:
            name: The name as written.
            scope: Full name of the class in which the name is written.

        Raises:
            NoSuchClassError: There is no such class.
        """
        if name in BUILT_IN:
            return None
        if name.startswith("."):
            return self.get(name)
        first, _, rest = name.partition(".")
        while True:
            start = self._visible(scope, first)
            if start is not None:
                found = self._inside(start, rest)
                if found is not None:
                    return found
            if not scope:
                raise NoSuchClassError(f"there is no class {name}")
            scope = scope.rpartition(".")[0]

    def members(self, package: str) -> list[str]:
        """Returns the names of the classes in a package, in the order of the package."""
        folder = self._folder(package)
        inner = list(self.get(package).definition.classes)
        if folder is None:
            return inner
        names = {f.stem for f in folder.glob("*.mo")} | {
            f.parent.name for f in folder.glob("*/package.mo")
        }
        names = (names - {"package"}) | set(inner)
        order = folder / "package.order"
        listed = order.read_text("utf-8").split() if order.exists() else []
        return [name for name in listed if name in names] + sorted(names - set(listed))

    def _visible(self, scope: str, first: str) -> str | None:
        """Returns the full name of the class that a name means in one scope, None if unknown."""
        if scope:
            here = self._class(scope)
            if here is not None and first in here.imports:
                return here.imports[first]
        found = self._inside(scope, first)
        return None if found is None else found.path

    def _inside(self, scope: str, name: str) -> Found | None:
        path = scope
        for part in filter(None, name.split(".")):
            inner = f"{path}.{part}" if path else part
            if self._class(inner) is None:
                inherited = self._inherited(path, part) if path else None
                if inherited is None:
                    return None
                inner = inherited.path
            path = inner
        definition = self._class(path) if path else None
        return None if definition is None else Found(path, definition)

    def _inherited(self, path: str, name: str) -> Found | None:
        definition = self._class(path)
        for base in definition.bases if definition is not None else ():
            if base.class_name in BUILT_IN:
                continue
            try:
                # Looking up base classes among inherited classes, too, would never end.
                parent = self._base(base.class_name, path)
            except NoSuchClassError:
                continue
            found = self._inside(parent, name)
            if found is not None:
                return found
        return None

    def _base(self, name: str, scope: str) -> str:
        first, _, rest = name.lstrip(".").partition(".")
        outer = scope.rpartition(".")[0]
        while True:
            inner = f"{outer}.{first}" if outer else first
            if self._class(inner) is not None:
                return f"{inner}.{rest}" if rest else inner
            if not outer:
                raise NoSuchClassError(f"there is no class {name}")
            outer = outer.rpartition(".")[0]

    def _class(self, path: str) -> Class | None:
        if path not in self._classes:
            self._classes[path] = self._load(path)
        return self._classes[path]

    def _load(self, path: str) -> Class | None:
        parent, _, name = path.rpartition(".")
        if parent:
            outer = self._class(parent)
            if outer is None:
                return None
            if name in outer.classes:
                return outer.classes[name]
        for file in self._files(path):
            try:
                return parse(file.read_text("utf-8"))
            except ModelicaSyntaxError as error:
                raise ModelicaSyntaxError(f"{file}: {error}") from None
        return None

    def _files(self, path: str) -> Iterator[Path]:
        for folder in self._folders:
            place = folder.joinpath(*path.split("."))
            for file in (place / "package.mo", place.with_name(f"{place.name}.mo")):
                if file.exists():
                    yield file

    def _folder(self, path: str) -> Path | None:
        for file in self._files(path):
            return file.parent if file.name == "package.mo" else None
        return None
