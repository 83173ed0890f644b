"""Command `service`: installs, upgrades or removes the service and what belongs to it."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path, PurePosixPath

from ecatd.admin.installation.actions import Action
from ecatd.admin.installation.places import CONFIGURATION, Place, here, unit
from ecatd.admin.installation.removal import uninstall
from ecatd.admin.installation.service import install, upgrade
from ecatd.base.errors import UsageError
from ecatd.base.version import VERSION

from .arguments import add_yes, confirm
from .output import print_json

COMMANDS = {"machine": {"service": "Install, upgrade or remove the systemd service."}}

_ACTIONS = """\
actions:
  install    install systemd units, udev rules, man pages, completion and files for monitoring; make
             the user `ecatd` and the group `ecat`; make the service start when the machine boots
  upgrade    install the new files after `pip install --upgrade`; a running bus keeps running
  uninstall  ask, stop the services, remove these files, and restore those that they replaced;
             --purge also removes /etc/ecatd, /var/lib/ecatd, unit drop-ins, users and groups
"""


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments, and sets the function of the command."""
    command.formatter_class = argparse.RawDescriptionHelpFormatter
    command.epilog = _ACTIONS
    command.add_argument(
        "action",
        choices=("install", "upgrade", "uninstall"),
        metavar="ACTION",
        help="one of the actions below",
    )
    command.add_argument(
        "--interface", metavar="IF", help="install: write a configuration for this interface"
    )
    command.add_argument("--purge", action="store_true", help="uninstall: also remove your files")
    command.add_argument(
        "-n", "--dry-run", action="store_true", help="say what would be done, and do nothing"
    )
    command.add_argument(
        "--root",
        default="/",
        metavar="DIR",
        help="install into the file system of an image at DIR, and run no system commands",
    )
    add_yes(command)


def service(options: argparse.Namespace) -> None:
    """Takes the actions of the command one after the other, and reports each.

    Raises:
        EcatError: An action cannot be taken.
    """
    try:
        root = Path(options.root).resolve(strict=True)
    except (OSError, RuntimeError, ValueError) as error:
        raise UsageError(f"--root {options.root!r} is not a folder: {error}") from error
    if not options.root or not root.is_dir():
        raise UsageError(f"--root {options.root!r} is not a folder")
    if options.interface is not None and options.action != "install":
        raise UsageError(f"--interface is for install, not for {options.action}")
    if options.purge and options.action != "uninstall":
        raise UsageError(f"--purge is for uninstall, not for {options.action}")
    place = here(root)
    before = place.enabled()
    if options.action == "install":
        actions = list(install(place, options.bus, options.interface))
    elif options.action == "upgrade":
        actions = list(upgrade(place))
    else:
        actions = list(uninstall(place, purge=options.purge))
    if options.action == "uninstall" and place.is_running and not options.dry_run:
        confirm(
            options,
            "This stops the services of all buses of this machine (drives stop, slaves go to INIT) "
            "and removes them.",
        )
    for action in actions:
        if not options.dry_run:
            action.do()
        if not options.json:
            with suppress(BrokenPipeError):  # the action goes on even if nobody reads the output
                print(_line(action, dry_run=options.dry_run), flush=True)
    following = [] if options.dry_run else list(_next(place, options, before))
    if options.json:
        print_json(
            {
                "version": VERSION,
                "dry_run": options.dry_run,
                "steps": [{"verb": s.verb, "what": s.what, "why": s.why} for s in actions],
                "next": following,
            }
        )
        return
    for line in following:
        print(f"next: {line}")
    if options.action == "upgrade" and not options.dry_run and not following:
        print("all is up to date")


def _line(action: Action, *, dry_run: bool) -> str:
    verb = f"would {action.verb}" if dry_run and action.effect is not None else action.verb
    return f"{verb:<13} {action.what}" + (f"  ({action.why})" if action.why else "")


def _next(place: Place, options: argparse.Namespace, before: set[str]) -> Iterator[str]:
    """What the user does next, with the services that were enabled before."""
    if options.action == "install":
        yield from _after_installation(place, options.bus)
    elif options.action == "upgrade":
        for name in place.outdated():
            yield (
                f"{name} still runs the previous version: run `systemctl restart {name}` when the "
                "machine may stop"
            )
    elif not options.purge:
        yield (
            f"`{place.programs}/ecatctl service uninstall --purge{_root(place)}` also removes the "
            "files that were kept"
        )
        for name in sorted(before):
            yield (
                f"after another `service install`, `systemctl enable {name}` has it start with the "
                "machine again"
            )


def _root(place: Place) -> str:
    """The option that names the file system, if it is not that of this machine."""
    return "" if place.is_here else f" --root {place.root}"


def _after_installation(place: Place, bus: str) -> Iterator[str]:
    ctl = "ecatctl" if bus == "ecat0" else f"ecatctl --bus {bus}"
    yield "`usermod -aG ecat USER` for each user of the bus, who then has to log in again"
    file = CONFIGURATION / f"{bus}.toml"
    if not place.at(file).exists():
        yield f"`{ctl} service install --interface IF{_root(place)}` writes {file}"
    systemctl = "systemctl" if place.is_here else f"systemctl --root {place.root}"
    program = PurePosixPath(place.programs / "ecatd")
    if not place.is_here and not place.at(program).exists():
        yield f"install ecatd in {place.root} as {program}, where the links lead"
    for name in map(unit, sorted({bus, *place.configured()})):
        if name not in place.enabled() and not place.is_masked(name):
            yield f"`{systemctl} enable {name}` has it start with the machine"
    where = "" if place.is_here else f"when the machine of {place.root} runs: "
    yield f"{where}`systemctl start {unit(bus)}`; `{ctl} check` says whether the bus is well"
