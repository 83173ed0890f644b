"""sd_notify(3): tells systemd the state of a service."""

from __future__ import annotations

import contextlib
import os
import socket

_PATIENCE = 2.0
"""Most seconds to wait until the service manager has read earlier messages."""


def is_managed() -> bool:
    """Whether a service manager has started this process."""
    return bool(os.environ.get("NOTIFY_SOCKET"))


def notify(*lines: str, wait: bool = True) -> None:
    """Sends assignments such as `READY=1` to the service manager, if there is one.

    Args:
        lines: The assignments.
        wait: Whether to wait a little if the service manager does not read its messages. If not,
            the message is lost then, which does no harm if it is sent regularly.
    """
    address = os.environ.get("NOTIFY_SOCKET")
    if not address:
        return
    if address.startswith("@"):
        address = "\0" + address[1:]
    # Slaves and processes must be stopped in order even if the service manager is gone.
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        sender.settimeout(_PATIENCE if wait else 0.0)
        sender.sendto("\n".join(lines).encode(), address)
