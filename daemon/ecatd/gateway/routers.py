"""Reports when routers are reached or lost, because Zenoh tries to connect again silently."""

from __future__ import annotations

import asyncio
from functools import partial

import zenoh

from ecatd.certificates import name_of_router
from ecatd.log import Log
from ecatd.model.bus_name import HOST_NAME
from ecatd.model.config import GatewayConfig
from ecatd.model.config.gateway import is_encrypted

from .access import router_names
from .aside import aside

_PERIOD = 1.0
_PATIENCE = 5
"""Looks before a router that was never reached is reported."""


async def watch_routers(session: zenoh.Session, config: GatewayConfig, log: Log) -> None:
    """Logs each change of the number of reached routers; ends at once if there are no routers.

    Args:
        session: The gateway's session.
        config: The configuration, which names the routers.
        log: The log for these reports.
    """
    told, looks, endpoints = -1, 0, config.connect
    while endpoints:
        found = min(len(session.info.routers_zid()), len(endpoints))
        looks += 1
        if found != told and (found or told > 0 or looks > _PATIENCE):
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
            told = found
        await asyncio.sleep(_PERIOD)


async def _check_names(config: GatewayConfig, log: Log) -> None:
    """Warns of routers that cannot pass on anything, since their certificates have other names."""
    for endpoint in filter(is_encrypted, config.connect):
        name = await aside(partial(name_of_router, endpoint, config))
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
