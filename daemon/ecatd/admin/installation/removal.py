"""Removes what the installation has made, and with `purge` also what was added since then."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path, PurePosixPath

from ecatd.base.errors import StateError
from ecatd.base.paths import DOCTOR_CHANGES

from .actions import Action, Remove, RemoveFolder, RemoveTree, Restore, run
from .buses import autostart_links, is_masked
from .places import (
    ADMINISTRATION,
    CONFIGURATION,
    LOCAL,
    LOGS,
    MEMORY,
    SOCKETS,
    STATE,
    Place,
    files,
)
from .record import BEFORE, LIST, OLD, copies, is_ours, read_record
from .service import refuse_package, tell_system

_USERS = ("ecatd", "ecatd-gateway")
_GROUPS = ("ecat", "ecatd-gateway")
_OF_UNITS = re.compile(r"ecatd(-gateway)?(@[^/]*)?\.service(\.d)?")
"""The names of the units of ecatd, and of the folders with changes of them."""
_NAMES_MAX = 5
"""Most files of a folder in one line."""


def uninstall(place: Place, *, purge: bool) -> Iterator[Action]:
    """The actions that stop the services and remove what `install` has written.

    Args:
        place: Where.
        purge: Remove the configuration, the files of the service, the users and the groups, too.

    Raises:
        StateError: Nothing is installed, or a package of the distribution has installed it.
    """
    refuse_package(place, "purge" if purge else "remove")
    record = read_record(place)
    if not record.files and not purge:
        raise StateError("no service is installed, so there is nothing to remove")
    if place.is_running:
        stop = "the drives are stopped, and the slaves go to INIT"
        yield run("systemctl", "stop", "ecatd.service", "ecatd@*.service", why=stop, may_fail=True)
    for link in autostart_links(place):
        yield Remove(
            "remove", str(place.seen(link)), f"{link.name} no longer starts with the machine", link
        )
    actions = list(_remove_installed(place, record.files, purge=purge))
    if record.files:
        actions.append(Remove("remove", str(LIST), "", place.at(LIST)))
    yield from actions
    yield from _remove_folders(place, record.folders, actions)
    for folder in (SOCKETS, MEMORY):
        if place.at(folder).is_dir():
            yield RemoveFolder("remove", str(folder), "if no other ecatd runs", place.at(folder))
    if place.at(changes := SOCKETS.with_name(DOCTOR_CHANGES)).is_file():
        what = "what `ecatctl doctor --fix` has changed, until the machine starts again"
        yield _remove_or_keep(place, place.at(changes), what, purge=purge)
    yield from _remove_settings(place, purge=purge)
    for folder, what in (
        (CONFIGURATION, "your configuration"),
        (STATE, "files about faults"),
        (LOGS, "the audit file"),
    ):
        yield from _remove_tree(place, place.at(folder), what, purge=purge)
    yield from tell_system(place, users=False)
    if place.root == Path("/"):
        yield from _remove_users(purge=purge)


def _remove_installed(place: Place, listed: Mapping[str, str], *, purge: bool) -> Iterator[Action]:
    """Removes what was installed, and restores what was there before."""
    known = {str(path) for path in files(LOCAL, place.programs / "ecatd")}
    for path in sorted(known | set(listed)):
        file = place.at(PurePosixPath(path))
        if not place.holds(file):
            continue
        is_free = not (file.exists() or file.is_symlink())
        if path in listed and not is_free:
            if is_ours(file, listed[path]):
                is_free = True
                yield Remove("remove", path, "", file)
            elif purge and file.is_file() and not file.is_symlink() and "link:" not in listed[path]:
                is_free = True
                yield Remove("remove", path, "you have changed it", file)
            else:
                yield Action("keep", path, "changed since it was installed: remove it yourself")
        earlier = copies(file, BEFORE)
        if is_free and earlier:
            copy = earlier.pop()
            yield Restore("restore", path, f"from {place.seen(copy)}, your own file", file, copy)
        for copy in earlier:
            yield Action(
                "keep", str(place.seen(copy)), "your own file from before the installation"
            )
        for copy in copies(file, OLD):
            yield _remove_or_keep(place, copy, f"{path} as you had changed it", purge=purge)


def _remove_or_keep(place: Place, file: Path, what: str, *, purge: bool) -> Action:
    path = str(place.seen(file))
    return Remove("remove", path, what, file) if purge else Action("keep", path, what)


def _remove_folders(
    place: Place, made: Iterable[str], actions: Iterable[Action]
) -> Iterator[Action]:
    """Removes the folders that the installation has made, if they are empty then."""
    gone = {action.path for action in actions if isinstance(action, Remove)}
    gone |= {action.copy for action in actions if isinstance(action, Restore)}
    gone -= {action.path for action in actions if isinstance(action, Restore)}
    for path in sorted(made, key=len, reverse=True):  # files before their folder
        folder = place.at(PurePosixPath(path))
        if folder.is_symlink() or not folder.is_dir() or not place.holds(folder):
            continue
        if gone.issuperset(folder.iterdir()):
            gone.add(folder)
            yield RemoveFolder("remove", path, "a folder that is empty then", folder)


def _remove_settings(place: Place, *, purge: bool) -> Iterator[Action]:
    """Changes of the units by the administrator: drop-ins, masks, units in their place."""
    for folder in (ADMINISTRATION, ADMINISTRATION.with_name("system.control")):
        if not place.at(folder).is_dir() or not place.holds(place.at(folder)):
            continue
        for item in sorted(place.at(folder).iterdir()):
            if not _OF_UNITS.fullmatch(item.name):
                continue
            if item.name.endswith(".d"):
                yield from _remove_tree(place, item, "your settings of the unit", purge=purge)
            elif is_masked(place, item.name):
                yield _remove_or_keep(place, item, "the unit is masked", purge=purge)
            else:
                yield Action("keep", str(place.seen(item)), "a unit of yours: remove it yourself")


def _remove_tree(place: Place, folder: Path, what: str, *, purge: bool) -> Iterator[Action]:
    """Removes a folder of the administrator or the service, and names each file in it."""
    path = str(place.seen(folder))
    if folder.is_symlink() or folder.is_file():
        yield _remove_or_keep(place, folder, what, purge=purge)
        return
    if not folder.is_dir():
        return
    if not place.holds(folder):
        yield Action("keep", path, f"its folder leads out of {place.root}")
        return
    inside = sorted(item for item in folder.rglob("*") if item.is_symlink() or not item.is_dir())
    if not purge:
        names = ", ".join(str(item.relative_to(folder)) for item in inside[:_NAMES_MAX])
        more = f" and {len(inside) - _NAMES_MAX} more" if len(inside) > _NAMES_MAX else ""
        yield Action("keep", path, f"{what}: {names or 'it is empty'}{more}")
        return
    for item in inside:
        yield Remove("remove", str(place.seen(item)), what, item)
    why = "" if os.access(folder, os.R_OK | os.X_OK) else "use sudo to see the files in it"
    yield RemoveTree("remove", path, why, folder)


def _remove_users(*, purge: bool) -> Iterator[Action]:
    if not purge:
        what = f"users {' and '.join(_USERS)}, groups {' and '.join(_GROUPS)}"
        yield Action("keep", what, "files may belong to them")
        return
    for user in _USERS:
        yield run("userdel", user, may_fail=True)
    for group in _GROUPS:
        yield run("groupdel", group, may_fail=True)
