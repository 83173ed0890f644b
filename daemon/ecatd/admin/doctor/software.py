"""Checks the configuration, versions, and free room and leftovers in shared memory."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

from ecatd.base.errors import EcatError
from ecatd.base.paths import MACHINE, control_socket, search_dirs
from ecatd.base.version import VERSION
from ecatd.config import Config, RealTimeConfig, load_config
from ecatd.config.flight_recorder import FlightRecorderConfig
from ecatd.linux.systemd_services import other_version
from ecatd.shm.files import MEMORY, folders, problem
from ecatd.shm.statistics import read

from .findings import Area, Finding

_AREA = Area("configuration")
_PACKAGES = ("pysoem", "eclipse-zenoh", "msgpack", "jinja2")
_ROOM_MIB = 64
_OWNER = "start ecatd as root, or its service: it puts the directory right, or says what hinders it"


def look_at_configuration(file: Path) -> tuple[Finding, Config | None]:
    """Checks whether a configuration is valid, and returns it, too.

    Args:
        file: The file, which may not exist.
    """
    name = str(file)
    if not file.exists():
        bus = "" if file.stem == "ecat0" else f"--bus {file.stem} "
        remedy = f"`ecatctl {bus}service install --interface IF` writes {file}"
        if file.parent != MACHINE:
            remedy = "name an existing file"
        return _AREA.hint(name, "the file does not exist", remedy), None
    try:
        config = load_config(file)
    except EcatError as error:
        remedy = f"`ecatd --check-config --config {file}` after each change"
        return _AREA.problem(name, str(error), remedy), None
    return _AREA.ok(name, "valid"), config


def look_at_settings(realtime: RealTimeConfig) -> Iterator[Finding]:
    """Finds settings that make cycles late. What is right depends on the machine."""
    for key, is_slow, text in (
        ("priority", realtime.priority == 0, "0: other programs delay the engine"),
        ("dma_latency_us", realtime.dma_latency_us < 0, "-1: processors may sleep deeply"),
        (
            "poll_us",
            realtime.poll_us == 0 and not realtime.busy_receive,
            "0: the engine falls asleep before each answer",
        ),
    ):
        if is_slow:
            name, remedy = f"realtime.{key}", f"remove realtime.{key}: the default is better"
            yield _AREA.hint(name, text, remedy, cost=key)


def look_at_recorder(config: FlightRecorderConfig) -> Iterator[Finding]:
    """Checks whether incidents can be written, if the configuration wants them."""
    if config.folder and find_spec("mcap") is None:
        text = f"the package mcap is missing, so no incidents are written to {config.folder}"
        remedy = "pip install 'ecatd[record]', then restart ecatd"
        yield _AREA.problem("flight_recorder", text, remedy)


def look_at_shared_memory() -> Iterator[Finding]:
    """Checks free room and leftovers in /dev/shm."""
    area = Area("shared memory")
    state = os.statvfs(MEMORY)
    free = state.f_bavail * state.f_frsize >> 20
    text = f"{free} MiB free in {MEMORY}"
    if free < _ROOM_MIB:
        remedy = f"remove what fills it: `du -a {MEMORY}`"
        yield area.problem("room", text, remedy)
    else:
        yield area.ok("room", text)
    for text in filter(None, map(problem, folders())):
        yield area.problem("owner", text, _OWNER)
    for file in sorted(file for folder in folders() for file in folder.glob("*.out")):
        bus = file.stem
        if not any(os.path.exists(control_socket(folder, bus)) for folder in search_dirs()):  # noqa: PTH110
            text = f"{file} is left over from bus '{bus}', whose ecatd was killed"
            remedy = "the next start of the bus replaces it; or remove it"
            yield area.hint("left over", text, remedy)


def look_at_versions(bus: str) -> Iterator[Finding]:
    """Checks the versions of ecatd, of the packages that it needs, and of the running daemon."""
    area = Area("versions")
    found = [f"ecatd {VERSION}"]
    for name in _PACKAGES:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            remedy = "install ecatd again with pip"
            yield area.problem(name, "it is not installed", remedy)
    yield area.ok("installed", ", ".join(found))
    with suppress(EcatError):
        if advice := other_version(bus, read(bus).version):
            yield area.hint("running", advice.text, advice.remedy)
