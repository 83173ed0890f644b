"""The Zenoh keys, for gateway and clients.

Each key but `alive` has `ro` or `rw` after the name of the bus, so that access control can
distinguish reading from writing. The keys for a user of another machine have `as/NAME` before `rw`.

Where several machines use one Zenoh router, the name of a bus begins with the name of its machine:
`cell4/ecat0`. In a key this is the single part `cell4:ecat0`, so `ecat/v1/*/alive` finds all buses.
"""

from __future__ import annotations

import json
from typing import Any

import zenoh

VERSION = "v1"
SCHEMA = 1
AS = "as"
"""The part of a key before the name of a user."""


def bus_key(bus: str, *rest: str) -> str:
    """Returns a key below a bus, for example `bus_key("ecat0", "ro", "info")`.

    Args:
        bus: BUS or HOST/BUS; `*` for all buses.
        rest: The parts after the bus.
    """
    return "/".join(("ecat", VERSION, bus.replace("/", ":"), *rest))


def bus_of(key: object) -> str:
    """Returns the bus of a key: BUS or HOST/BUS."""
    return str(key).split("/")[2].replace(":", "/")


def full_name(host: str, bus: str) -> str:
    """Returns the name of a bus for other machines: HOST/BUS, or BUS if the host is empty."""
    return f"{host}/{bus}" if host else bus


def session_config(mode: str, settings: dict[str, Any]) -> zenoh.Config:
    """Returns a Zenoh configuration without scouting: it connects only to addresses in `settings`.

    Args:
        mode: `peer` for the gateway, `client` for its clients.
        settings: Further settings by path, for example `{"listen/endpoints": […]}`.
    """
    config = zenoh.Config()
    quiet = {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
    }
    for path, value in (quiet | settings).items():
        config.insert_json5(path, json.dumps(value))
    return config
