"""The Zenoh keys, and rules of access control for them, for gateway, clients and routers.

Each key but `alive` has `ro` or `rw` after the name of the bus, so that access control can
distinguish reading from writing. The keys for a user of another machine have `as/NAME` before `rw`.

Where several machines use one Zenoh router, the name of a bus begins with the name of its machine:
`cell4/ecat0`. In a key this is the single part `cell4:ecat0`, so `ecat/v1/*/alive` finds all buses.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import zenoh

VERSION = "v1"
SCHEMA = 1
AS = "as"
"""The part of a key before the name of a user."""


FROM_READERS = ("query", "declare_subscriber", "liveliness_query", "declare_liveliness_subscriber")
"""Kinds of messages that readers of a bus send to its gateway."""
FROM_GATEWAY = ("put", "reply", "declare_queryable", "liveliness_token")
"""Kinds of messages that the gateway sends to readers."""
READ = ("ro/**", "alive")
"""The keys below a bus for reading."""


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


def rule(
    name: str, flow: str, messages: Sequence[str], bus: str, keys: Sequence[str]
) -> dict[str, Any]:
    """Returns a rule that allows messages in one direction for keys below a bus.

    Args:
        name: Name of the rule.
        flow: `ingress` or `egress`, as seen by the process with the rule.
        messages: Kinds of messages.
        bus: Name of the bus; `*` for all buses, `HOST/$*` for all buses of a machine.
        keys: Keys below the bus.
    """
    return {
        "id": name,
        "flows": [flow],
        "messages": list(messages),
        "key_exprs": [bus_key(bus, key) for key in keys],
        "permission": "allow",
    }
