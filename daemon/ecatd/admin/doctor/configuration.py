"""Checks the configuration of a bus."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ecatd.base.errors import EcatError
from ecatd.base.paths import MACHINE
from ecatd.config import Config, RealTimeConfig, load_config

from .findings import Area, Finding

_AREA = Area("configuration")


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
