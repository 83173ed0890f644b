"""Checks whether the certificates of `[gateway]` can be used, and sees when they are renewed."""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from ecatd.base.log import Log
from ecatd.config import GatewayConfig

_APART = ("KEY_VALUES_MISMATCH", "KEY_TYPE_MISMATCH")  # reasons of OpenSSL
_PERIOD_S = 2.0


def wrong_certificates(config: GatewayConfig) -> str:
    """Returns what is wrong with the certificates and what to do; empty if nothing is wrong."""
    for key, path in _paths(config):
        try:
            path.read_bytes()
        except FileNotFoundError:
            return f"gateway.{key}: there is no file {path}; `ecatctl remote init` makes it"
        except OSError as error:
            return (
                f"gateway.{key}: the gateway cannot read {path}: {error.strerror}. As a service "
                f"it has the user 'ecatd-gateway': sudo chgrp ecatd-gateway {path}; sudo chmod 640 "
                f"{path}"
            )
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        if config.certificate:
            context.load_cert_chain(config.certificate, config.key)
    except (ssl.SSLError, OSError, ValueError) as error:
        apart = getattr(error, "reason", "") in _APART
        why = "do not belong together" if apart else "are not PEM files"
        return (
            f"gateway.certificate {config.certificate} and gateway.key {config.key} {why}: "
            "`ecatctl remote init` makes such a pair"
        )
    try:
        if config.users_ca:
            context.load_verify_locations(config.users_ca)
    except (ssl.SSLError, OSError, ValueError):
        return f"gateway.users_ca {config.users_ca} has no certificate in PEM"
    return ""


async def watch_certificates(
    config: GatewayConfig, used: list[bytes], log: Log, on_change: Callable[[], None]
) -> None:
    """Calls a function once when files have changed and can be used, as after a renewal.

    Args:
        config: The configuration that names them.
        used: What was in them when they were last checked.
        log: The log, which says so, also if the new ones cannot be used.
        on_change: Has another gateway started, which reads the files.
    """
    before = known = used
    while True:
        await asyncio.sleep(_PERIOD_S)
        now = contents(config)
        # While files are being written, they differ from one look to the next.
        if now == before and now not in (used, known):
            known = now
            if not (wrong := wrong_certificates(config)):
                log.info("the certificates have changed: the gateway starts again to use them")
                on_change()
                return
            log.warning(f"the certificates have changed, but the new ones are not used: {wrong}")
        before = now


def contents(config: GatewayConfig) -> list[bytes]:
    """What is in the files of the certificates, of those that can be read."""
    found = []
    for key, path in _paths(config):
        with suppress(OSError):
            found.append(key.encode() + path.read_bytes())
    return found


def _paths(config: GatewayConfig) -> list[tuple[str, Path]]:
    """The files of the certificates, by the keys that name them."""
    keys = ("certificate", "key", "users_ca")
    return [(key, Path(path)) for key in keys if (path := getattr(config, key))]
