"""Folders in which users keep device profiles and templates for the generator."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from ecatd.model.bus import Bus


def add_options(command: argparse.ArgumentParser) -> None:
    """The options that add folders."""
    for name, what in (("profiles", "device profiles"), ("templates", "templates")):
        command.add_argument(
            f"--{name}",
            action="append",
            default=[],
            metavar="DIR",
            type=Path,
            help=f"folder with {what} of yours, before those of ~/.config/ecatd/{name}; may be "
            "repeated, the first one wins",
        )


def folders(given: list[Path], name: str) -> list[Path]:
    """Folders in the order in which they count: those of the options, and the standard one.

    Args:
        given: Folders of the options.
        name: Name of the standard folder, which counts only if it exists.
    """
    base = Path(os.environ.get("XDG_CONFIG_HOME", ""))
    if not base.is_absolute():  # is to be ignored (XDG Base Directory Specification)
        base = Path(os.environ.get("HOME", "/nonexistent")) / ".config"
    standard = base / "ecatd" / name
    return [*given, *([standard] if standard.is_dir() else [])]


def unused_profiles(given: list[Path], bus: Bus) -> list[str]:
    """What to tell of device profiles that were given, but fit no slave: one sentence each.

    Raises:
        ConfigError: A device profile is wrong.
    """
    from ecatgen.profiles import user_devices

    return [
        f"{device.source}: '{device.description}' fits no slave of bus {bus.name}: it is about "
        f"{device.wanted}"
        for device in user_devices(given)
        if not any(device.fits(slave) for slave in bus.slaves)
    ]
