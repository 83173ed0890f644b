"""Reports when routers are reached or lost, because Zenoh tries to connect again silently."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

import zenoh

from ecatd.log import Log

_PERIOD = 1.0
_PATIENCE = 5
"""Looks before a router that was never reached is reported."""


async def watch_routers(session: zenoh.Session, endpoints: Sequence[str], log: Log) -> None:
    """Logs each change of the number of reached routers; ends at once if there are no routers.

    Args:
        session: The gateway's session.
        endpoints: The addresses of the routers, `gateway.connect`.
        log: The log for these reports.
    """
    told, looks = -1, 0
    while endpoints:
        found = min(len(session.info.routers_zid()), len(endpoints))
        looks += 1
        if found != told and (found or told > 0 or looks > _PATIENCE):
            where = ", ".join(endpoints)
            if found == len(endpoints):
                log.info(f"connected to {where}")
            else:
                count = f"{found} of {len(endpoints)} routers are" if found else "no router is"
                log.warning(
                    f"{count} reached at {where} (gateway.connect); ecatd keeps trying, and the "
                    "bus can be reached in all other ways"
                )
            told = found
        await asyncio.sleep(_PERIOD)
