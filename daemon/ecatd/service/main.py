"""The command `ecatd`."""

from __future__ import annotations

import argparse
import json
import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

from ecatd.base.bus_name import check_bus_name
from ecatd.base.errors import EcatError, StateError, UsageError
from ecatd.base.lazy_command import CommandLine
from ecatd.base.log import Log
from ecatd.base.log_levels import OTHERS
from ecatd.base.paths import profile_folders
from ecatd.base.sanitized_output import print_output, sanitized_output, write_no_more
from ecatd.base.version import VERSION
from ecatd.config import Config, load_config, read_config
from ecatd.config.origins import COMMAND_LINE, Origin, Origins, find_origins, texts
from ecatd.config.profiles import load_profiles
from ecatd.config.resolve import alike_slaves, load_description, missing_folders

from .processes import PYTHON
from .supervisor import Supervisor

_EPILOG = """\
examples:
  ecatd --simulate troll             the simulated rig "troll"; needs no root and no hardware
  sudo ecatd --interface eth1        the slaves on a network interface
  ecatd --config /etc/ecatd/ecat0.toml

`ecatctl slaves` then shows what is on the bus.

exit status:
  0 stopped by a signal   2 wrong usage or configuration   3 no such interface or no slaves
  4 a slave does not answer in time   5 a slave refuses an SDO   6 not permitted
  7 the bus does not reach OP   70 a defect in ecatd
"""


def make_parser() -> argparse.ArgumentParser:
    """The parser of the command line."""
    parser = CommandLine(
        prog="ecatd",
        description="Run an EtherCAT bus and share its process image.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    source = parser.add_mutually_exclusive_group()
    source.add_argument(
        "--interface", metavar="IF", help="network interface to which the slaves are connected"
    )
    source.add_argument(
        "--simulate", metavar="RIG", help="run a simulated rig instead of hardware (see ecatsim)"
    )
    parser.add_argument(
        "--replay",
        metavar="FILE",
        type=Path,
        help="with --simulate: play a recording (`ecatctl record --raw`) or an incident "
        "into the inputs",
    )
    source.add_argument(
        "--only-gateway",
        action="store_true",
        help="run only the gateway of a bus that another ecatd runs with --no-gateway",
    )
    source.add_argument(
        "--only-ros",
        action="store_true",
        help="run only what ROS 2 sees of a bus: [ros] of the configuration",
    )
    parser.add_argument(
        "--no-gateway",
        action="store_true",
        help="run no gateway and nothing for ROS 2, because services of their own run them",
    )
    parser.add_argument("--config", metavar="FILE", type=Path, help="configuration file (TOML)")
    parser.add_argument(
        "--check-config", action="store_true", help="check the configuration and exit"
    )
    parser.add_argument(
        "--describe",
        action="store_true",
        help="print the bus description, as `ecatctl scan` does, and exit without running the bus",
    )
    parser.add_argument("--bus", metavar="NAME", help="name of the bus (default: ecat0)")
    parser.add_argument(
        "--cycle-time-us", metavar="N", type=int, help="base cycle in microseconds (default: 1000)"
    )
    parser.add_argument("-v", "--verbose", action="store_true", help="log details")
    parser.add_argument("-q", "--quiet", action="store_true", help="log only warnings and errors")
    parser.add_argument(
        "--version", action="version", version=f"ecatd {VERSION}", help="print the version"
    )
    return parser


def _configuration(options: argparse.Namespace) -> tuple[Config, Origins]:
    """The configuration of the file, with the changes of the command line, and its origins."""
    config = load_config(options.config) if options.config else Config()
    origins = find_origins(config) if options.config else {}
    given: dict[str, Any] = {
        key: getattr(options, key)
        for key in ("bus", "interface", "cycle_time_us")
        if getattr(options, key) is not None
    }
    origins |= dict.fromkeys(given, Origin())
    if options.verbose or options.quiet:
        given["log"] = {OTHERS: "debug" if options.verbose else "warning"}
        origins[f"log.{OTHERS}"] = Origin()
    if given:
        config = read_config({**config.to_dict(), **given}, COMMAND_LINE, texts(origins))
    if options.replay and not options.simulate:
        raise UsageError("--replay needs a simulated rig: add --simulate RIG")
    if not (config.interface or options.simulate or options.check_config):
        raise UsageError(
            "ecatd does not know where the slaves are: give --interface IF, or --config FILE "
            "with the key 'interface', or --simulate troll to try it without hardware"
        )
    return config, origins


def _checked(options: argparse.Namespace) -> tuple[Config, Origins]:
    """Checks the configuration, and all files that a start would read for it."""
    config, origins = _configuration(options)
    _check_files(config)
    return config, origins


def _check_files(config: Config) -> None:
    load_profiles(config, profile_folders())
    load_description(config)


def main() -> int:
    """Runs the daemon until a signal ends it; returns the exit status. SIGHUP is ignored so far."""
    try:
        with sanitized_output():
            return _main()
    except KeyboardInterrupt:  # before the supervisor handles signals
        return 0
    finally:
        try:
            sys.stderr.flush()
        except OSError:  # Python's own exit status would be 120
            write_no_more(sys.stderr)


def _become_gateway(options: argparse.Namespace) -> None:
    others = {name for name, value in vars(options).items() if value not in (None, False)}
    if wrong := sorted(others - {"only_gateway", "bus"}):
        option = wrong[0].replace("_", "-")
        raise UsageError(
            f"--{option} has no effect with --only-gateway: give only --bus, since the gateway "
            "gets all settings from the ecatd that runs the bus"
        )
    bus = check_bus_name(options.bus or Config().bus)
    os.execv(PYTHON[0], (*PYTHON, "ecatd.gateway", bus, "--alone"))


def _become_ros(options: argparse.Namespace) -> None:
    others = {name for name, value in vars(options).items() if value not in (None, False)}
    if wrong := sorted(others - {"only_ros", "bus", "config"}):
        option = wrong[0].replace("_", "-")
        raise UsageError(f"--{option} has no effect with --only-ros: give only --config and --bus")
    if not options.config:
        raise UsageError("--only-ros needs the configuration of the bus: add --config FILE")
    config = load_config(options.config)
    if not config.ros.connect:
        raise UsageError(
            f"{options.config} names no router of ROS 2: add connect to [ros], such as "
            'connect = "tcp/192.168.1.5:7447"'
        )
    bus = check_bus_name(options.bus or config.bus)
    os.execv(PYTHON[0], (*PYTHON, "ecatd.ros", bus, "--alone", str(options.config)))


def _main() -> int:
    options = make_parser().parse_args()
    log = Log("ecatd")
    try:
        if options.only_gateway:
            _become_gateway(options)
        if options.only_ros:
            _become_ros(options)
        config, origins = _configuration(options)
        log.set_bus(config.bus)
        log.levels = config.log
        if options.check_config:
            _check_files(config)
            for warning in alike_slaves(config) + missing_folders(config):
                log.warning(warning)
            print_output(f"{options.config or 'the default configuration'} is valid\n")
            return 0
        supervisor = Supervisor(
            config,
            origins,
            options.simulate,
            log,
            lambda: _checked(options),
            describe=options.describe,
            gateway=not options.no_gateway,
            replay=options.replay,
        )
        return supervisor.run()
    except EcatError as error:
        log.error(str(error))
        if options.describe:
            with suppress(StateError):  # the status says what has failed
                print_output(json.dumps({"error": error.to_reply()}) + "\n")
        return error.exit_code


if __name__ == "__main__":
    sys.exit(main())
