"""Plans how a folder must change to hold the generated files and those of the user."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from ecatd.base.errors import StateError

from . import order
from .folder import MANIFEST, Folder, Tree, digest, manifest_of, parents

_COPY = ".orig"
_NAMED = 8  # most files that a message names


@dataclass(slots=True)
class Plan:
    """The changes to a folder; paths are relative to it.

    Attributes:
        folder: The folder as it is now.
        tree: The generated files, by path.
        files: `tree` with the manifest, and with the user's classes in every `package.order`.
        written: Generated files that are new or differ.
        unchanged: Generated files that are in the folder already.
        removed: Files of an earlier run that are no longer generated.
        kept: The user's files: old path by new path.
        conflicts: The user's files that are in the way: reason by path.
        copies: New names by path, under which these files are kept if `force` is given.
        empty: Empty folders of the user.
    """

    folder: Folder
    tree: Tree
    files: dict[str, bytes] = field(default_factory=dict)
    written: list[str] = field(default_factory=list)
    unchanged: list[str] = field(default_factory=list)
    removed: list[str] = field(default_factory=list)
    kept: dict[str, str] = field(default_factory=dict)
    conflicts: dict[str, str] = field(default_factory=dict)
    copies: dict[str, str] = field(default_factory=dict)
    empty: list[str] = field(default_factory=list)

    @property
    def regenerated(self) -> list[str]:
        """Files whose generated content differs from that of the run before.

        A file that only one of the two runs has generated counts, too. The list is empty if the
        manifest of the run before is missing.
        """
        before = self.folder.manifest
        if not before:
            return []
        return [
            path
            for path in {**before, **self.tree}
            if path not in before
            or path not in self.tree
            or before[path] != digest(self.tree[path])
        ]

    @property
    def is_needed(self) -> bool:
        """Whether the folder will change."""
        return bool(self.written or self.removed or self.conflicts)

    def place(self, path: str) -> str:
        """Returns the path of a user's file in the new folder."""
        for item in (path, *parents(path)):
            if item in self.copies:
                return self.copies[item] + path[len(item) :]
        return path

    def copy_name(self, path: str) -> str:
        """Returns a free name for a file in the way: with `.orig`, `.orig2` and so on."""
        name, number = path + _COPY, 1
        taken = {*self.folder.files, *self.folder.folders, *self.files, *self.copies.values()}
        while name in taken:
            number += 1
            name = f"{path}{_COPY}{number}"
        return name


def make_plan(folder: Folder, tree: Tree) -> Plan:
    """Compares the folder with the generated files."""
    plan = Plan(folder, tree)
    ours = folder.manifest
    foreign = [
        path for path in folder.files if path not in ours and path not in tree and path != MANIFEST
    ]
    files, clashes = order.merge(tree, folder, foreign)
    plan.files = files | {MANIFEST: manifest_of(tree)}
    plan.conflicts |= dict.fromkeys(clashes, "has the name of a generated class")
    for path in sorted(plan.files):
        _compare(plan, path)
    for path in sorted(ours.keys() & folder.files.keys() - plan.files.keys()):
        if _is_ours(folder, path) or path.rpartition("/")[2] == order.NAME:
            plan.removed.append(path)
        else:
            plan.conflicts[path] = "changed, and not generated any more"
    _find_blocked(plan, foreign)
    for path in sorted(plan.conflicts):
        plan.copies[path] = plan.copy_name(path)
    moved = plan.conflicts.keys() & folder.files.keys()
    plan.kept = {plan.place(path): path for path in sorted({*foreign, *moved})}
    used = {"", *plan.files, *(parent for path in folder.files for parent in parents(path))}
    plan.empty = sorted(folder.folders.keys() - used)
    return plan


def _compare(plan: Plan, path: str) -> None:
    """Notes whether a generated file is unchanged or written, and any conflict it causes."""
    folder = plan.folder
    data = folder.data(path)
    if data == plan.files[path]:
        plan.unchanged.append(path)
        return
    plan.written.append(path)
    if path not in folder.files or path == MANIFEST:
        return
    if path not in folder.manifest:
        plan.conflicts[path] = "not generated"
    elif path.rpartition("/")[2] != order.NAME and not _is_ours(folder, path):
        plan.conflicts[path] = "changed"


def _is_ours(folder: Folder, path: str) -> bool:
    """Whether a file is unchanged since an earlier run has written it."""
    data = folder.data(path)
    return data is not None and digest(data) == folder.manifest[path]


def _find_blocked(plan: Plan, foreign: Iterable[str]) -> None:
    """Finds files in the places of new folders, and folders in the places of new files."""
    for path in plan.files:
        for parent in parents(path):
            if parent in plan.folder.files and parent not in plan.removed:
                plan.conflicts[parent] = "in the place of a folder"
    for path in foreign:
        for parent in parents(path):
            if parent in plan.files:
                plan.conflicts[parent] = "in the place of a file"


def refuse(plan: Plan) -> None:
    """Refuses the plan if it needs `force`.

    Raises:
        StateError: Files of the user are in the way, or the manifest is missing or damaged.
    """
    path = plan.folder.path
    if plan.folder.problem:
        raise StateError(
            f"nothing was written, because {path} {plan.folder.problem}. Move it away, choose "
            f"another folder, or add --force, which keeps the files there as FILE{_COPY}"
        )
    if plan.conflicts:
        named = [f"{item} ({why})" for item, why in sorted(plan.conflicts.items())]
        text = ", ".join(named[:_NAMED])
        text += f" and {len(named) - _NAMED} more" if len(named) > _NAMED else ""
        raise StateError(
            f"nothing was written, because {path} has files that you have made or changed: "
            f"{text}. Move them away, or add --force, which keeps them as FILE{_COPY}"
        )
