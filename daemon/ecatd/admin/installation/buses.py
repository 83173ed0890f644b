"""The buses of a machine: which have a configuration, which start with the machine, which run."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from ecatd.base.bus_name import BUS_NAME
from ecatd.linux.systemd_services import service

from .places import ADMINISTRATION, CONFIGURATION, LOCAL, SOCKETS, Place

_MASKED = Path("/dev/null")
_OF_BUSES = re.compile(r"ecatd(@.+)?\.service")


def unit(bus: str) -> str:
    """The service of a bus."""
    return f"{service(bus)}.service"


def configured(place: Place) -> list[str]:
    """The buses that have a configuration."""
    names = (file.stem for file in place.at(CONFIGURATION).glob("*.toml"))
    return sorted(name for name in names if BUS_NAME.fullmatch(name))


def autostart_links(place: Place) -> list[Path]:
    """The links by which systemd starts services of buses with the machine."""
    links = place.at(ADMINISTRATION).glob("*.*/ecatd*.service")
    return sorted(
        link
        for link in links
        if link.parent.suffix in (".wants", ".requires") and _OF_BUSES.fullmatch(link.name)
    )


def enabled(place: Place) -> set[str]:
    """The services of buses that start with the machine."""
    names = {link.name for link in autostart_links(place)}
    return {"ecatd.service" if name == "ecatd@ecat0.service" else name for name in names}


def is_masked(place: Place, name: str) -> bool:
    """Whether the administrator has forbidden a service to start."""
    link = place.at(ADMINISTRATION / name)
    return link.is_symlink() and link.readlink() == _MASKED


def outdated(place: Place) -> Iterator[str]:
    """The running services that were started before the program or their units were written."""
    program = Path(__file__).stat().st_ctime
    units = place.at(LOCAL["units"]).glob("ecatd*.service")
    changed = max([program, *(file.stat().st_mtime for file in units if file.is_file())])
    for socket in sorted(place.at(SOCKETS).glob("*/control")):
        if socket.stat().st_mtime < changed:
            yield unit(socket.parent.name)
