"""Rules of Zenoh's access control, for the gateway and for routers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .zenoh_keys import bus_key

ASKING = ("query", "declare_subscriber", "liveliness_query", "declare_liveliness_subscriber")
"""What those who read a bus send to its gateway."""
TELLING = ("put", "reply", "declare_queryable", "liveliness_token")
"""What the gateway sends to those who read."""
READ = ("ro/**", "alive")
"""Keys below a bus that are read."""


def rule(
    name: str, flow: str, messages: Sequence[str], bus: str, keys: Sequence[str]
) -> dict[str, Any]:
    """A rule: messages in one direction that are allowed for keys below a bus.

    Args:
        name: Name of the rule.
        flow: `ingress` or `egress`, as seen by the one who has the rule.
        messages: Kinds of messages.
        bus: Name of the bus; `*` for all, and `HOST/$*` for all of a machine.
        keys: Keys below the bus.
    """
    return {
        "id": name,
        "flows": [flow],
        "messages": list(messages),
        "key_exprs": [bus_key(bus, key) for key in keys],
        "permission": "allow",
    }
