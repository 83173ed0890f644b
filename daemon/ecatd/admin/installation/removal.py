"""Removes what the installation has made, and with `purge` also what was added since then."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from ecatd.base.errors import StateError
from ecatd.base.paths import DOCTOR_CHANGES

from .actions import Action, remove_empty, run
from .installed_files import read_record, take_away
from .places import (
    ADMINISTRATION,
    CONFIGURATION,
    LOCAL,
    LOGS,
    MEMORY,
    SOCKETS,
    STATE,
    WEB,
    WEB_OPTIONS,
    Place,
    files,
)
from .service import refuse_package, tell_system

_USERS = ("ecatd", "ecatd-gateway", "ecatd-web", "ecatd-ros")
_GROUPS = ("ecat", "ecatd-gateway", "ecatd-web", "ecatd-ros")
_LEFT = {
    SOCKETS.with_name(DOCTOR_CHANGES): (
        "what `ecatctl doctor --fix` has changed, until the machine starts again"
    ),
    CONFIGURATION: "your configuration",
    STATE: "files about faults",
    LOGS: "the audit file",
    WEB_OPTIONS: "your options of ecatd-web",
}
"""What only a purge removes, besides changes of the units."""
_OF_UNITS = re.compile(r"ecatd(-gateway|-web|-ros)?(@[^/]*)?\.service(\.d)?")
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
    if not read_record(place).files and not purge:
        raise StateError("no service is installed, so there is nothing to remove")
    if place.is_running:
        stop = "the drives are stopped, and the slaves go to INIT"
        units = ("ecatd-web.service", "ecatd-ros@*.service", "ecatd.service", "ecatd@*.service")
        yield run("systemctl", "stop", *units, why=stop, may_fail=True)
    for link in place.autostart_links():
        why = f"{link.name} no longer starts with the machine"
        yield place.remove(link, why)
    yield from take_away(place, files(LOCAL, place.programs / "ecatd"), purge=purge)
    for folder in map(place.at, (SOCKETS, WEB, MEMORY)):
        if folder.is_dir():
            why = "if no other ecatd runs"
            yield place.action("remove", folder, why, partial(remove_empty, folder))
    yield from _remove_settings(place, purge=purge)
    for path, what in _LEFT.items():
        yield from _remove_left(place, place.at(path), what, purge=purge)
    yield from tell_system(place, users=False)
    if place.is_here and purge:
        for user in _USERS:
            yield run("userdel", user, may_fail=True)
        for group in _GROUPS:
            yield run("groupdel", group, may_fail=True)
    elif place.is_here:
        what = f"users {', '.join(_USERS)}, groups {', '.join(_GROUPS)}"
        yield Action("keep", what, "files may belong to them")


def _remove_settings(place: Place, *, purge: bool) -> Iterator[Action]:
    """Changes of the units by the administrator: drop-ins, masks, units in their place."""
    for folder in map(place.at, (ADMINISTRATION, ADMINISTRATION.with_name("system.control"))):
        if not folder.is_dir() or not place.holds(folder):
            continue
        for item in sorted(folder.iterdir()):
            if not _OF_UNITS.fullmatch(item.name):
                continue
            if item.name.endswith(".d"):
                yield from _remove_left(place, item, "your settings of the unit", purge=purge)
            elif place.is_masked(item.name):
                yield place.remove_or_keep(item, "the unit is masked", purge=purge)
            else:
                yield place.keep(item, "a unit of yours: remove it yourself")


def _remove_left(place: Place, item: Path, what: str, *, purge: bool) -> Iterator[Action]:
    """Removes a file or folder of the administrator or the service, and names each file in it."""
    if item.is_symlink() or item.is_file():
        yield place.remove_or_keep(item, what, purge=purge)
    elif item.is_dir() and not place.holds(item):
        yield place.keep(item, f"its folder leads out of {place.root}")
    elif item.is_dir():
        inside = sorted(path for path in item.rglob("*") if path.is_symlink() or not path.is_dir())
        if purge:
            for file in inside:
                yield place.remove(file, what)
            why = "" if os.access(item, os.R_OK | os.X_OK) else "use sudo to see the files in it"
            yield place.remove(item, why)
        else:
            names = ", ".join(str(file.relative_to(item)) for file in inside[:_NAMES_MAX])
            more = f" and {len(inside) - _NAMES_MAX} more" if len(inside) > _NAMES_MAX else ""
            yield place.keep(item, f"{what}: {names or 'it is empty'}{more}")
