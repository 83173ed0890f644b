"""sd_notify(3): tells systemd how a service is."""

from __future__ import annotations

import contextlib
import os
import socket

_PATIENCE = 2.0
"""Seconds that the service manager has to read: this process has better things to do than wait."""


def is_managed() -> bool:
    """Whether a service manager has started this process."""
    return bool(os.environ.get("NOTIFY_SOCKET"))


def notify(*lines: str, wait: bool = True) -> None:
    """Sends assignments such as `READY=1` to the service manager, if there is one.

    Args:
        lines: The assignments.
        wait: Wait a little while the service manager does not come to reading. Otherwise the
            message is lost then, which is right for one that is sent again and again.
    """
    address = os.environ.get("NOTIFY_SOCKET")
    if not address:
        return
    if address.startswith("@"):
        address = "\0" + address[1:]
    # A service manager that is gone is no reason to leave slaves and processes behind.
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        sender.settimeout(_PATIENCE if wait else 0.0)
        sender.sendto("\n".join(lines).encode(), address)
