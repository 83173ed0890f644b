"""Gets the bus description for `scan` and `generate`: from a daemon, a file, or a rig.

Rigs and ESI files are not interpreted here: a daemon runs on their simulation until it has scanned
the slaves (`ecatd --describe`). So all sources give the same library, byte for byte.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Literal

from ecatd.base.bus_name import check_bus_name
from ecatd.base.errors import ConfigError, EcatError, UsageError, error_class
from ecatd.config import Config, load_config
from ecatd.config.origins import find_origins
from ecatd.description import bus_file
from ecatd.description.bus import Bus
from ecatd.operations.bus import ReadStates

from .arguments import connect
from .bus_warnings import warn, warn_outdated

Kind = Literal["scan", "rig", "esi"]

_FILES = (".json", ".toml", ".py", ".xml")
_PEEK = 4096
_BOMS = (b"\xef\xbb\xbf", b"\xff\xfe", b"\xfe\xff")


def add_options(command: argparse.ArgumentParser) -> None:
    """Adds the options that choose the source of the description."""
    command.add_argument(
        "--from",
        dest="sources",
        action="append",
        default=[],
        metavar="SOURCE",
        help="read the bus from SOURCE instead of a running daemon: a scan saved by 'ecatctl "
        "scan -o', a rig (name or file), or an ESI file or a folder of them (can be given "
        "several times) with --devices",
    )
    command.add_argument(
        "--devices",
        metavar="LIST",
        help="with ESI files: the slaves in the order of the wire, such as "
        "EK1100,EL1018,3*EL2008; EL1018:0x00110000 names a revision, Island[DI8,-,AI2] the "
        "modules of a device; or a file with one slave in each line (default: the [[slave]] "
        "tables of --config)",
    )
    command.add_argument(
        "--config",
        metavar="FILE",
        type=Path,
        help="with a rig or ESI files: configuration of the daemon (cycle time, domains, units)",
    )
    command.add_argument(
        "--strict",
        action="store_true",
        help="refuse ESI files with mistakes (default: warn about each mistake, and leave that "
        "part out)",
    )


def use_bus_of(options: argparse.Namespace, config: Config) -> None:
    """Has a command use the bus of a configuration file, unless `--bus` or $ECATD_BUS names one."""
    if not options.chosen_bus and "bus" in find_origins(config):
        options.bus = config.bus


def get_bus(options: argparse.Namespace) -> tuple[Bus, dict[str, Any]]:
    """Gets the description of the bus that the options choose.

    Returns:
        The description; and for `--json`, `outdated`: see `warn_outdated`. It is empty if no daemon
        was asked.

    Raises:
        EcatError: There is no description, or the options or files are wrong.
    """
    kinds = check_options(options)
    if not kinds:
        with connect(options) as remote:
            bus, rows = remote.describe(), remote.request(ReadStates())["slaves"]
        return bus, {"outdated": warn_outdated(bus, rows)}
    return _without_daemon(options, kinds[0]), {"outdated": []}


def _without_daemon(options: argparse.Namespace, kind: Kind) -> Bus:
    """The description from a saved scan, a rig, or ESI files."""
    sources: list[str] = options.sources
    if kind == "scan":
        bus = bus_file.load(Path(sources[0]))
        bus.name = check_bus_name(options.given_bus or bus.name)
        return bus
    if kind == "rig":
        return _described(sources[0], options)
    from . import esi_rig

    if options.devices:
        source, wanted = "--devices", esi_rig.listed(options.devices)
    else:
        source, wanted = str(options.config), esi_rig.expected(options.config)
    text = esi_rig.rig(sources, wanted, strict=options.strict)
    with tempfile.TemporaryDirectory(prefix="ecatctl-") as folder:
        rig = Path(folder) / "rig.toml"
        rig.write_text(text, "utf-8")
        try:
            return _described(str(rig), options)
        except ConfigError as error:
            if error.file != str(rig):
                raise
            raise ConfigError(error.problem, source) from None  # the user knows no other file


def _kind(source: str) -> Kind:
    """Finds out the kind of a source from its name and content."""
    path = Path(source)
    if path.is_dir():
        return "esi"
    if path.suffix.lower() in (".py", ".toml"):
        return "rig"  # the simulator reports what is wrong with it
    try:
        with path.open("rb") as file:
            head = file.read(_PEEK)
    except FileNotFoundError:
        if path.suffix.lower() in _FILES or "/" in source:
            raise UsageError(f"there is no file '{source}'") from None
        return "rig"
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise UsageError(f"{source}: cannot be read: {reason}") from None
    for bom in _BOMS:
        head = head.removeprefix(bom)
    first = head.replace(b"\0", b"").lstrip()[:1]
    if first == b"<":
        return "esi"
    if first == b"{":
        return "scan"
    raise UsageError(
        f"{source}: is neither a saved scan (JSON, by 'ecatctl scan -o'), nor a rig (.toml or "
        ".py), nor an ESI file (XML)"
    )


def check_options(options: argparse.Namespace) -> list[Kind]:
    """Checks that the options fit together; returns the kinds of the sources.

    Raises:
        UsageError: They do not fit together.
    """
    kinds = [_kind(source) for source in options.sources]
    kind = kinds[0] if kinds else "live"
    if len(kinds) > 1 and set(kinds) != {"esi"}:
        raise UsageError("several --from are possible only with ESI files: give one --from")
    if kinds and options.connect is not None:
        raise UsageError("--connect asks a daemon, and --from needs none: give only one of them")
    if options.config is not None and kind not in ("rig", "esi"):
        what = "a saved scan" if kind == "scan" else "a running bus"
        raise UsageError(f"--config is only for a rig or ESI files: {what} is configured already")
    if kind == "esi" and not options.devices and options.config is None:
        raise UsageError(
            "an ESI file describes devices, but not which of them are on the bus: add --devices, "
            "as in --devices EK1100,EL1018,3*EL2008, or --config FILE with the expected slaves"
        )
    if options.devices and kind != "esi":
        raise UsageError("--devices is only for ESI files: add --from FILE.xml")
    return kinds


def _described(rig: str, options: argparse.Namespace) -> Bus:
    """Runs a daemon on a simulated rig, and returns its bus description.

    Raises:
        EcatError: The daemon has failed; it has the message of the daemon or of the simulator.
    """
    if options.config is not None:
        use_bus_of(options, load_config(options.config))
    command = [sys.executable, "-P", "-m", "ecatd.service", "--describe", "--quiet"]
    command += ["--simulate", rig, "--bus", options.bus]
    command += ["--config", str(options.config)] if options.config is not None else []
    ended = subprocess.run(
        command, stdin=subprocess.DEVNULL, capture_output=True, check=False, encoding="utf-8"
    )
    try:
        answer = json.loads(ended.stdout)
    except ValueError:
        raise error_class(ended.returncode)(
            f"ecatd has ended with status {ended.returncode} and said nothing"
        ) from None
    if "error" in answer:
        raise EcatError.from_reply(answer["error"])
    warn(answer.get("warnings", []))
    return bus_file.parse(ended.stdout, f"the description of {rig}")
