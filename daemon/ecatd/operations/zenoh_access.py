"""Rules of Zenoh's access control, for the gateway and for routers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .zenoh_keys import bus_key

ASKING = ("query", "declare_subscriber", "liveliness_query", "declare_liveliness_subscriber")
"""Kinds of messages that readers of a bus send to its gateway."""
TELLING = ("put", "reply", "declare_queryable", "liveliness_token")
"""Kinds of messages that the gateway sends to readers."""
READ = ("ro/**", "alive")
"""The keys below a bus for reading."""


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
