"""Command `web`: a page in the browser that shows a bus, a recording or an incident."""

from __future__ import annotations

import argparse
import asyncio
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from ecatd.base.bus_name import check_bus_name, check_full_bus_name
from ecatd.base.errors import StateError, UsageError
from ecatd.base.files import write_whole
from ecatd.operations.catalog import RIGHT_NAMES
from ecatd.operations.endpoints import Endpoint
from ecatd.web.listening import Address, read_address
from ecatd.web.tls import CERTIFICATE, KEY, LOGINS

from .arguments import bounded
from .output import print_json_line
from .saving import writing

if TYPE_CHECKING:
    from ecatd.client.identity import Identity
    from ecatd.web.hub import Hub
    from ecatd.web.server import Server

GATEWAY = "tls/localhost:7448"
"""Where the gateway of this machine listens for users, as `ecatctl remote init` has it."""

COMMANDS = {"health": {"web": "Show the bus in a browser: lamps, topology, signals of each cycle."}}


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments of the command."""
    command.add_argument(
        "file",
        type=Path,
        nargs="?",
        metavar="FILE",
        help="show this recording or incident (MCAP) instead of a bus",
    )
    command.add_argument(
        "--port",
        type=bounded(0, 65535),
        metavar="N",
        help="listen at this port; 0 for any that is free (default: 8570, or the next "
        "one that is free)",
    )
    command.add_argument(
        "--address",
        type=_address,
        metavar="ADDRESS[:PORT]",
        help="listen at this IP address, 0.0.0.0 for all of this machine (default: 127.0.0.1). All "
        "but those of loopback are encrypted, and users log in with a password",
    )
    command.add_argument(
        "--certificate",
        type=Path,
        metavar="FILE",
        help=f"certificate of the server, also to encrypt at a loopback address (default: "
        f"{CERTIFICATE}, of `ecatctl remote web`)",
    )
    command.add_argument(
        "--key", type=Path, metavar="FILE", help=f"its private key (default: {KEY})"
    )
    command.add_argument(
        "--logins",
        type=Path,
        default=LOGINS,
        metavar="DIR",
        help=f"the folder of those who may log in, of `ecatctl remote login` (default: {LOGINS})",
    )
    command.add_argument(
        "--address-file",
        type=Path,
        metavar="FILE",
        help="write the address of the page into this file, for its group, until the end",
    )
    command.add_argument(
        "--no-browser", action="store_true", help="print the address, and open no browser"
    )
    command.add_argument(
        "--allow",
        type=_rights,
        default=(),
        metavar="RIGHT,...",
        help=f"let pages do more than read: {', '.join(RIGHT_NAMES)} (default: none)",
    )


def _address(text: str) -> Address:
    try:
        return read_address(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"'{text}' is no ADDRESS[:PORT]: {error}") from error


def _rights(text: str) -> tuple[str, ...]:
    found = tuple(dict.fromkeys(filter(None, text.split(","))))
    for right in found:
        if right not in RIGHT_NAMES:
            raise argparse.ArgumentTypeError(
                f"'{right}' is not a right: choose from {', '.join(RIGHT_NAMES)}"
            )
    return found


def web(options: argparse.Namespace) -> None:
    """Serves the page until Ctrl-C."""
    if find_spec("websockets") is None:
        raise StateError("`ecatctl web` needs the package websockets: pip install 'ecatd[web]'")
    from ecatd.web.files import read_files

    asyncio.run(_serve(options, read_files()))
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    # Threads may wait for Zenoh, and the end of Python within a call of it would be an abort.
    os._exit(0)


async def _serve(options: argparse.Namespace, files: dict[str, tuple[str, bytes]]) -> None:
    from ecatd.web.browser import open_browser

    server = _server(options, files)
    with open_browser() as show, _told(options.address_file, server.address):

        def ready() -> None:
            if options.json:
                print_json_line({"address": server.address})
            else:
                print(f"{server.address}\nCtrl-C ends.", flush=True)
            if not options.no_browser and (
                os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
            ):
                show(server.address)

        await server.run(ready)
    print(file=sys.stderr)


@contextmanager
def _told(file: Path | None, address: str) -> Iterator[None]:
    """Has the address in a file, which its group may read."""
    if file is None:
        yield
        return
    with writing(file):
        write_whole(file, f"{address}\n".encode(), f".{file.name}-")
        file.chmod(0o640)
    try:
        yield
    finally:
        with suppress(OSError):
            file.unlink()


def _server(options: argparse.Namespace, files: dict[str, tuple[str, bytes]]) -> Server:
    from ecatd.web.server import for_this_machine, for_users

    address = _chosen_address(options)
    if address.is_loopback and not options.certificate:
        return for_this_machine(lambda bus: _hub(options, bus, None), files, address)
    if options.file is not None:
        raise UsageError(
            f"{options.file} is shown at a loopback address only: who logs in has rights on a bus, "
            "and none on a file"
        )
    if not Endpoint.of(options.connect or GATEWAY).is_encrypted:
        raise UsageError(
            f"users are known by their certificates, and {options.connect} takes none: name the "
            f"address of the gateway for users, such as --connect {GATEWAY}"
        )
    pair = options.certificate or CERTIFICATE, options.key or KEY
    return for_users(
        lambda bus, identity: _hub(options, bus, identity), files, address, pair, options.logins
    )


def _chosen_address(options: argparse.Namespace) -> Address:
    address: Address = options.address or Address()
    if options.port is None:
        return address
    if address.port is not None:
        raise UsageError("the port is given twice: in --address, and with --port")
    return address._replace(port=options.port)


def _hub(options: argparse.Namespace, bus: str, identity: Identity | None) -> Hub:
    """What pages see of a bus, for an empty name of that of the options; or of their file."""
    from ecatd.web.hub import Hub

    if options.file is not None:
        from ecatd.web.file_source import FileSource

        if options.allow:
            raise UsageError("--allow is for a bus: nothing in a file can be changed")
        return Hub(FileSource(options.file))
    from ecatd.client.remote import Remote
    from ecatd.web.bus import BusSource

    bus = bus or options.bus
    # Users are known by their certificates, so the way to the daemon is encrypted, too.
    connect = options.connect or (GATEWAY if identity else None)
    check_full_bus_name(bus) if connect else check_bus_name(bus)
    user = identity.user if identity else ""
    return Hub(
        BusSource(bus, lambda: Remote(bus, connect, options.timeout, identity), options.allow, user)
    )
