"""Reports addresses on which the gateway cannot listen yet, and when it listens on them after all.

Zenoh tries an address again and again, but does not report it. When a machine boots, a network
interface may get its address long after the bus is in OP.
"""

from __future__ import annotations

import asyncio
import errno
import os
import socket
from collections.abc import Sequence
from functools import partial

from ecatd.base.daemon_threads import in_daemon_thread
from ecatd.base.log import Log
from ecatd.operations.endpoints import PROTOCOLS, Endpoint

_PERIOD = 2.0
_DATAGRAMS = ("udp", "quic")
_PATIENCE = 2.0
"""Seconds for the look-up of a name: the gateway must not wait for a name server that is down."""
_IN_USE = "the address is in use"


class Listening:
    """The addresses of one gateway.

    Args:
        endpoints: Zenoh endpoints, such as `tcp/10.0.0.5:7447`.
        log: The log for these reports.
    """

    def __init__(self, endpoints: Sequence[str], log: Log) -> None:
        self._endpoints = endpoints
        self._log = log
        self._problems: dict[str, str] = {}

    async def look(self) -> None:
        """Finds and reports the addresses that cannot be used. Call it before Zenoh uses them."""
        found_all = await asyncio.gather(*map(_find_soon, self._endpoints))
        for endpoint, found in zip(self._endpoints, found_all, strict=True):
            if found:
                self._problems[endpoint] = found
                self._log.warning(
                    f"not listening on {endpoint}: {found} (gateway.listen); it is tried again, "
                    f"and the bus can be reached from this machine and over the other addresses"
                )

    async def watch(self) -> None:
        """Reports when such an address can be used after all; ends when all of them can."""
        while self._problems:
            await asyncio.sleep(_PERIOD)
            for endpoint, before in list(self._problems.items()):
                found = await _find_soon(endpoint)
                if found == _IN_USE and before != _IN_USE:  # Zenoh has taken it
                    del self._problems[endpoint]
                    self._log.info(f"listening on {endpoint}")
                else:
                    self._problems[endpoint] = found


async def _find_soon(endpoint: str) -> str:
    """Runs `find_problem`, for which it waits a little."""
    try:
        return await asyncio.wait_for(in_daemon_thread(partial(find_problem, endpoint)), _PATIENCE)
    except TimeoutError:
        return "its name is not known yet"


def find_problem(endpoint: str) -> str:
    """Returns why no process can listen on an endpoint now; empty if one can, or if unknown."""
    place = Endpoint.of(endpoint)
    if place.protocol not in PROTOCOLS:
        return ""
    if place.interface and place.interface not in (name for _, name in socket.if_nameindex()):
        return f"this machine has no interface '{place.interface}'"
    rest = endpoint.partition("/")[2]
    try:
        with bound_socket(place) as probe:
            if probe.type == socket.SOCK_STREAM:
                probe.listen(1)
    except socket.gaierror as error:
        return f"'{rest}' is not an address here: {error.strerror}"
    except (UnicodeError, OverflowError):
        return f"'{rest}' is not an address"
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            return _IN_USE
        if error.errno == errno.EADDRNOTAVAIL:
            return "this machine does not have the address"
        return os.strerror(error.errno or errno.EIO)
    return ""


def bound_socket(endpoint: Endpoint) -> socket.socket:
    """Makes a socket that is bound to the address of an endpoint, and to its interface.

    Raises:
        OSError: The address does not exist here, or is in use.
        UnicodeError, OverflowError: It is no address.
    """
    kind = socket.SOCK_DGRAM if endpoint.protocol in _DATAGRAMS else socket.SOCK_STREAM
    family, kind, _, _, address = socket.getaddrinfo(
        endpoint.host, endpoint.port, type=kind, flags=socket.AI_PASSIVE
    )[0]
    made = socket.socket(family, kind)
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if endpoint.interface:
            made.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, endpoint.interface.encode())
        made.bind(address)
    except BaseException:
        made.close()
        raise
    return made
