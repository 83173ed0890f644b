"""Reports when routers are reached or lost, because Zenoh tries to connect again silently.

It also reports routers whose certificates have names that the configuration does not say.
"""

from __future__ import annotations

import asyncio
import socket
import ssl
from functools import partial
from typing import Any

import zenoh

from ecatd.base.bus_name import HOST_NAME
from ecatd.base.daemon_threads import in_daemon_thread
from ecatd.base.log import Log
from ecatd.config import GatewayConfig
from ecatd.operations.endpoints import Endpoint

from .access import router_names

_PERIOD = 1.0
_PATIENCE = 5
"""Looks before a router that was never reached is reported."""
_CONNECT_S = 2.0
"""Seconds for a connection that only asks for the certificate of a router."""


async def watch_routers(session: zenoh.Session, config: GatewayConfig, log: Log) -> None:
    """Logs each change of the number of reached routers; ends at once if there are no routers.

    Args:
        session: The gateway's session for the network.
        config: The configuration, which names the routers.
        log: The log for these reports.
    """
    reported, looks, endpoints = -1, 0, config.connect
    while endpoints:
        found = min(len(session.info.routers_zid()), len(endpoints))
        looks += 1
        if found != reported and (found or reported > 0 or looks > _PATIENCE):
            where = ", ".join(endpoints)
            if found == len(endpoints):
                log.info(f"connected to {where}")
                await _check_names(config, log)
            else:
                count = f"{found} of {len(endpoints)} routers are" if found else "no router is"
                log.warning(
                    f"{count} reached at {where} (gateway.connect); ecatd keeps trying, and the "
                    "bus can be reached in all other ways"
                )
            reported = found
        await asyncio.sleep(_PERIOD)


async def _check_names(config: GatewayConfig, log: Log) -> None:
    """Warns of routers that cannot pass on anything, since their certificates have other names."""
    for endpoint in filter(lambda item: item.is_encrypted, map(Endpoint.of, config.connect)):
        name = await in_daemon_thread(partial(_name_of_router, endpoint, config))
        if name and name not in router_names(config):
            remedy = (
                f'add router_names = ["{name}"] to [gateway], and reload'
                if HOST_NAME.fullmatch(name)
                else "it needs one with the name of a host (`ecatctl remote router`)"
            )
            log.warning(
                f"the certificate of the router at {endpoint} has the name {name!r}, so nothing of "
                f"this bus passes it: {remedy}"
            )


def _name_of_router(endpoint: Endpoint, config: GatewayConfig) -> str:
    """The common name in the certificate of a router; empty if that cannot be found out.

    Args:
        endpoint: The address of the router, `tls/HOST:PORT`.
        config: The configuration with the certificates of this gateway.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    try:
        context.load_verify_locations(config.users_ca)
        context.load_cert_chain(config.certificate, config.key)
        address = (endpoint.host, int(endpoint.port))
        with (
            socket.create_connection(address, _CONNECT_S) as connection,
            context.wrap_socket(connection) as encrypted,
        ):
            subject: Any = (encrypted.getpeercert() or {}).get("subject", ())
    except (OSError, ValueError):
        return ""
    return next((value for part in subject for key, value in part if key == "commonName"), "")
