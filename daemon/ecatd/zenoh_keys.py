"""The Zenoh keys, for gateway and clients.

Each key but `alive` has `ro` or `rw` after the name of the bus, so that access control can
distinguish reading from writing. A user of another machine has `as/NAME` before `rw`.
"""

from __future__ import annotations

import json
from typing import Any

import zenoh

VERSION = "v1"
SCHEMA = 1
AS = "as"
"""Before the name of a user."""
RIGHTS = ("ro", "rights")
"""Below the name of a user: what the user may do."""


def bus_key(bus: str, *rest: str) -> str:
    """A key below a bus, for example `bus_key("ecat0", "ro", "info")`."""
    return "/".join(("ecat", VERSION, bus, *rest))


def session_config(mode: str, settings: dict[str, Any]) -> zenoh.Config:
    """Returns a Zenoh configuration without scouting: it connects only where `settings` say so.

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
