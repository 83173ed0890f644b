"""Access control: who may do what over Zenoh.

Zenoh passes on only what the rules here allow, in both directions. So only the gateway can publish,
answer or declare a liveliness token under the keys of a bus. The certificate of a connection
identifies a user of another machine. Only the connection of user NAME may use the keys below
`as/NAME`, so the name in such a key can be trusted. `check` decides what the user may ask for, so
that a refused user gets a message.

If the gateway connects to a router (`gateway.connect`), the router identifies the users: it must
let only NAME use the keys below `as/NAME`. `ecatctl remote router` makes such settings. The name in
the router's certificate must be its host in `gateway.connect`, or one of `gateway.router_names`.
"""

from __future__ import annotations

import math
import time
from contextlib import suppress
from dataclasses import replace
from typing import Any

from ecatd.base.batch import Batch, last_of
from ecatd.base.errors import BusyError, NotPermittedError, StateError
from ecatd.base.log import Log
from ecatd.config import GatewayConfig, UserConfig
from ecatd.description.bus import Bus
from ecatd.operations.bus import Rights
from ecatd.operations.endpoints import ENCRYPTED, LOCAL, PLAIN, Endpoint
from ecatd.operations.operation import Operation, right_of
from ecatd.operations.zenoh_keys import AS, FROM_GATEWAY, FROM_READERS, READ, rule

_BURST_S, _WAIT_S = 1.0, 2.0
"""The allowed changes of the first number of seconds may come at once; those of the second number
of seconds may wait."""


def access_control(bus: str, config: GatewayConfig) -> dict[str, Any]:
    """Returns Zenoh's settings `access_control`.

    Args:
        bus: Name of the bus: BUS or HOST/BUS.
        config: The gateway's configuration.
    """
    rules = [
        # Anybody may ask all buses at once, to find out which buses there are.
        rule("ask", "ingress", FROM_READERS, "*", READ),
        rule("tell", "egress", FROM_GATEWAY, bus, READ),
        *_change("local", bus, "rw/**"),
    ]
    subjects: list[dict[str, Any]] = [
        {"id": "local", "link_protocols": [LOCAL]},
        {"id": "loopback", "interfaces": ["lo"], "link_protocols": [*PLAIN]},
    ]
    policies = [
        {"rules": ["ask", "tell", "want-local", "obey-local"], "subjects": ["local"]},
        {"rules": ["ask", "tell"], "subjects": ["loopback"]},
    ]
    if config.anonymous_reading:
        subjects.append({"id": "network", "link_protocols": [*PLAIN, *ENCRYPTED]})
        policies.append({"rules": ["ask", "tell"], "subjects": ["network"]})
    people = {f"user-{number}": user.name for number, user in enumerate(config.user)}
    hubs = {f"router-{number}": name for number, name in enumerate(router_names(config))}
    for who, name in (people | hubs).items():
        rules += _change(who, bus, f"{AS}/{name}/**" if who in people else f"{AS}/**")
        subjects.append({"id": who, "link_protocols": [*ENCRYPTED], "cert_common_names": [name]})
        policies.append({"rules": ["ask", "tell", f"want-{who}", f"obey-{who}"], "subjects": [who]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def router_names(config: GatewayConfig) -> list[str]:
    """The common names that routers may have in their certificates."""
    routers = map(Endpoint.of, config.connect)
    hosts = (router.host for router in routers if router.is_encrypted)
    return list(dict.fromkeys((*hosts, *config.router_names)))


def _change(who: str, bus: str, keys: str) -> list[dict[str, Any]]:
    """Returns the rules for a subject that may request changes below some keys."""
    return [
        rule(f"want-{who}", "ingress", ["query"], bus, [keys]),
        rule(f"obey-{who}", "egress", ["reply", "declare_queryable"], bus, [keys]),
    ]


def certificates(config: GatewayConfig) -> dict[str, Any]:
    """Returns Zenoh's settings for encryption; empty if there is no certificate."""
    if not config.certificate:
        return {}
    settings = {
        "listen_certificate": config.certificate,
        "listen_private_key": config.key,
        "close_link_on_expiration": True,
    }
    if config.user or config.connect:
        settings |= {
            "root_ca_certificate": config.users_ca,
            "enable_mtls": True,
            "connect_certificate": config.certificate,
            "connect_private_key": config.key,
        }
    return {f"transport/link/tls/{name}": value for name, value in settings.items()}


def without_encryption(config: GatewayConfig) -> GatewayConfig:
    """Returns the configuration without encrypted addresses, if certificates cannot be used."""
    listen, connect = (
        [item for item in endpoints if not Endpoint.of(item).is_encrypted]
        for endpoints in (config.listen, config.connect)
    )
    return replace(config, listen=listen, connect=connect, certificate="", user=[])


def unknown_slaves(config: GatewayConfig, bus: Bus) -> list[str]:
    """Returns warnings about slaves that users may change, but that do not exist."""
    found = []
    for user in config.user:
        for slave in user.slaves:
            try:
                bus.find(slave)
            except StateError as error:
                found.append(f"gateway.user.slaves of '{user.name}': {error}")
    return found


def rights(user: UserConfig) -> Rights:
    """Returns the rights of a user as a reply: `user`, `read`, `write`, `slaves` (empty: all)."""
    return {"user": user.name, "read": True, "write": user.write, "slaves": user.slaves}


def check(user: UserConfig, request: Operation[Any], bus: Bus) -> None:
    """Checks that a user may request a change, or frames.

    Raises:
        NotPermittedError: The user may not.
        StateError: The change is about a slave that does not exist.
    """
    kind = right_of(type(request))
    if kind not in user.write:
        may = f"may use: {', '.join(user.write)}" if user.write else "may only read"
        raise NotPermittedError(
            f"user '{user.name}' has no right '{kind}' on bus '{bus.name}', but {may} "
            f"(gateway.user.write in the configuration of the daemon)"
        )
    if not user.slaves or not request.slaves:
        return  # about no slave: levels of the log, or a transfer, whose number its client knows
    allowed: set[int | None] = set()
    for slave in user.slaves:
        with suppress(StateError):  # there is no such slave; `unknown_slaves` has warned of it
            allowed.add(bus.find(slave).position)
    wanted = (None if item is None else bus.find(item).position for item in request.slaves)
    if not allowed.issuperset(wanted):
        raise NotPermittedError(
            f"user '{user.name}' may change only slaves {', '.join(map(str, user.slaves))} of bus "
            f"'{bus.name}' (gateway.user.slaves in the configuration of the daemon)"
        )


class Refusals:
    """Logs refused changes. A user who goes on gets fewer and fewer lines, which tell how many.

    Args:
        log: The log.
    """

    def __init__(self, log: Log) -> None:
        self._log = log
        self._batches: dict[str, Batch[str]] = {}

    def note(self, user: str, text: str) -> None:
        """Takes one of a user whom the configuration names."""
        self._batches.setdefault(user, Batch(self._log_refusals)).note(text)

    def _log_refusals(self, texts: list[str], left_out: int) -> None:
        self._log.notice(f"refused: {last_of(texts, left_out)}")

    def close(self) -> None:
        """Logs those that still wait for their line."""
        for batch in self._batches.values():
            batch.close()


def too_many(user: UserConfig) -> BusyError:
    """The error that a user asks for too many changes."""
    return BusyError(
        f"user '{user.name}' asks for more than {user.changes_max:g} changes a second: wait "
        "(gateway.user.changes_max in the configuration of the daemon)"
    )


class Rate:
    """Limits the rate of one user's changes, so that a program that runs wild does no harm.

    Args:
        user: The user.
    """

    def __init__(self, user: UserConfig) -> None:
        self._user = user
        self._next = -math.inf  # when the next change may be carried out

    def delay(self) -> float:
        """Counts one change; returns the seconds until it may be carried out.

        Raises:
            BusyError: Too many changes are waiting.
        """
        now = time.monotonic()
        begin = max(self._next, now - _BURST_S)
        if begin - now > _WAIT_S:
            raise too_many(self._user)
        self._next = begin + 1 / self._user.changes_max
        return max(0.0, begin - now)
