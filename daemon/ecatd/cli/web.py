"""Command `web`: a page in the browser that shows a bus, a recording or an incident."""

from __future__ import annotations

import argparse
import asyncio
import os
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from ecatd.base.errors import StateError, UsageError
from ecatd.operations.catalog import RIGHT_NAMES

from .arguments import bounded, connect

if TYPE_CHECKING:
    from ecatd.web.hub import Source

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
        help="listen at this port of 127.0.0.1; 0 for any that is free (default: 8570, or the next "
        "one that is free)",
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
    from ecatd.web.hub import Hub
    from ecatd.web.server import Server, bind

    server = Server(Hub(_source(options)), files, bind(options.port))
    with open_browser() as show:

        def ready() -> None:
            print(f"{server.address}\nCtrl-C ends.", flush=True)
            if not options.no_browser and (
                os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
            ):
                show(server.address)

        await server.run(ready)
    print(file=sys.stderr)


def _source(options: argparse.Namespace) -> Source:
    if options.file is not None:
        from ecatd.web.file_source import FileSource

        if options.allow:
            raise UsageError("--allow is for a bus: nothing in a file can be changed")
        return FileSource(options.file)
    from ecatd.web.bus import BusSource

    return BusSource(options.bus, lambda: connect(options), options.allow)
