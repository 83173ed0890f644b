"""Command `service`: installs, upgrades or removes the service and what belongs to it."""

from __future__ import annotations

import argparse
from contextlib import suppress
from pathlib import Path

from ecatd.installation.service import (
    CONFIGURATION,
    Place,
    here,
    install,
    running,
    uninstall,
    unit,
    upgrade,
)
from ecatd.installation.steps import Step
from ecatd.model.errors import UsageError
from ecatd.version import VERSION

from .output import print_json

_ACTIONS = """\
actions:
  install    put units, rules of udev, man pages, completion and files for monitoring into place,
             make the user `ecatd` and the group `ecat`, and have the service start with the machine
  upgrade    the same after `pip install --upgrade`, for what is installed; a bus that runs goes on
  uninstall  stop the services and remove all that; --purge also removes configuration and user
"""


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments, and sets the function of the command."""
    command.formatter_class = argparse.RawDescriptionHelpFormatter
    command.epilog = _ACTIONS
    command.add_argument(
        "action",
        choices=("install", "upgrade", "uninstall"),
        metavar="ACTION",
        help="install, upgrade or uninstall, see below",
    )
    command.add_argument(
        "--interface", metavar="IF", help="install: write a configuration for this interface"
    )
    command.add_argument("--purge", action="store_true", help="uninstall: nothing stays")
    command.add_argument("-n", "--dry-run", action="store_true", help="only say what would be done")
    command.add_argument(
        "--root",
        default="/",
        metavar="DIR",
        help="install into the file system of an image; commands of the system are not run",
    )
    command.set_defaults(alone=service)


def service(options: argparse.Namespace) -> None:
    """Takes the steps of an action one after the other, and says each.

    Raises:
        EcatError: A step cannot be taken.
    """
    try:
        root = Path(options.root).resolve(strict=True)
    except (OSError, RuntimeError, ValueError) as error:
        raise UsageError(f"--root {options.root!r} is no folder: {error}") from error
    if not options.root or not root.is_dir():
        raise UsageError(f"--root {options.root!r} is no folder")
    if options.interface is not None and options.action != "install":
        raise UsageError(f"--interface is for install, not for {options.action}")
    if options.purge and options.action != "uninstall":
        raise UsageError(f"--purge is for uninstall, not for {options.action}")
    place = here(root)
    steps = _plan(place, options)
    for step in steps:
        if not options.dry_run:
            step.do()
        if not options.json:
            with suppress(BrokenPipeError):  # what has begun is finished, whoever listens
                print(_line(step, dry_run=options.dry_run), flush=True)
    following = _next(place, options)
    if options.json:
        print_json(
            {
                "version": VERSION,
                "dry_run": options.dry_run,
                "steps": [{"verb": s.verb, "what": s.what, "why": s.why} for s in steps],
                "next": following,
            }
        )
        return
    for line in following:
        print(f"next: {line}")


def _plan(place: Place, options: argparse.Namespace) -> list[Step]:
    if options.action == "install":
        return list(install(place, options.bus, options.interface))
    if options.action == "upgrade":
        return list(upgrade(place))
    return list(uninstall(place, purge=options.purge))


def _line(step: Step, *, dry_run: bool) -> str:
    verb = f"would {step.verb}" if dry_run and type(step) is not Step else step.verb
    return f"{verb:<12} {step.what}" + (f"  ({step.why})" if step.why else "")


def _next(place: Place, options: argparse.Namespace) -> list[str]:
    """What the user does next."""
    if options.dry_run or options.action == "uninstall":
        return []
    if options.action == "upgrade":
        return [
            f"{name} still runs the version before: `systemctl restart {name}`, when the machine "
            "may stop"
            for name in running(place)
        ]
    name = unit(options.bus)
    lines = ["`usermod -aG ecat USER` for those who may use the bus; they log in again then"]
    file = CONFIGURATION / f"{options.bus}.toml"
    if not place.at(file).exists():
        lines.append(f"`ecatctl service install --interface IF` writes {file}")
    return [*lines, f"`systemctl start {name}`; `ecatctl check` says whether the bus is well"]
