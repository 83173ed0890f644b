"""The configuration of a Zenoh router at which the buses of several machines meet."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ecatd.operations.zenoh_keys import AS, FROM_GATEWAY, FROM_READERS, READ, rule

_HEAD = """\
// A Zenoh router for ecatd, made by `ecatctl remote router`. Start it with: zenohd -c THIS_FILE
// Each machine may speak only for its own buses. Users read, and send changes under their own name;
// what a user may change is said in the configuration of each daemon ([[gateway.user]]).
"""


def router_config(
    listen: str,
    machines: Sequence[str],
    users: Sequence[str],
    certificate: Path,
    key: Path,
    authority: Path,
) -> str:
    """Returns the configuration, in JSON5.

    Args:
        listen: Zenoh endpoint of the router.
        machines: Names of the machines, which are the common names of their certificates.
        users: Names of the users, likewise.
        certificate: File with the certificate of the router.
        key: File with its key.
        authority: File with the certificates of those who sign those of machines and users.
    """
    rules = [
        rule("ask", "ingress", FROM_READERS, "*", READ),
        rule("be-asked", "egress", FROM_READERS, "*", READ),
        rule("be-told", "egress", FROM_GATEWAY, "*", READ),
    ]
    subjects: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []

    def let_in(who: str, name: str, allowed: list[str]) -> None:
        subjects.append({"id": who, "link_protocols": ["tls"], "cert_common_names": [name]})
        policies.append({"rules": allowed, "subjects": [who]})

    for number, name in enumerate(machines):
        who, buses = f"machine-{number}", f"{name}/$*"
        rules += [
            rule(f"tell-{who}", "ingress", FROM_GATEWAY, buses, READ),
            rule(f"obey-{who}", "ingress", ["reply", "declare_queryable"], buses, [f"{AS}/**"]),
            rule(f"change-{who}", "egress", ["query"], buses, [f"{AS}/**"]),
        ]
        let_in(who, name, [f"tell-{who}", f"obey-{who}", f"change-{who}", "be-asked"])
    for number, name in enumerate(users):
        who, own = f"user-{number}", [f"{AS}/{name}/**"]
        rules += [
            rule(f"want-{who}", "ingress", ["query"], "*", own),
            rule(f"answer-{who}", "egress", ["reply", "declare_queryable"], "*", own),
        ]
        let_in(who, name, ["ask", "be-told", f"want-{who}", f"answer-{who}"])
    settings = {
        "mode": "router",
        "listen": {"endpoints": [listen]},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {
            "link": {
                "tls": {
                    "root_ca_certificate": str(authority),
                    "listen_certificate": str(certificate),
                    "listen_private_key": str(key),
                    "enable_mtls": True,
                    "close_link_on_expiration": True,
                }
            }
        },
        "access_control": {
            "enabled": True,
            "default_permission": "deny",
            "rules": rules,
            "subjects": subjects,
            "policies": policies,
        },
    }
    return _HEAD + json.dumps(settings, indent=2) + "\n"
