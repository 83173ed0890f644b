"""Checks whether the certificates of `[gateway]` can be read and belong together."""

from __future__ import annotations

import ssl
from pathlib import Path

from ecatd.model.config import GatewayConfig


def wrong_certificates(config: GatewayConfig) -> str:
    """Returns what is wrong with the certificates and what to do; empty if nothing is wrong."""
    for key in ("certificate", "key", "users_ca"):
        if (path := getattr(config, key)) and (problem := _unreadable(key, Path(path))):
            return problem
    if config.certificate:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        try:
            context.load_cert_chain(config.certificate, config.key)
        except (ssl.SSLError, OSError, ValueError) as error:
            why = "do not belong together" if "MISMATCH" in str(error) else "are no PEM files"
            return (
                f"gateway.certificate {config.certificate} and gateway.key {config.key} {why}: "
                "`ecatctl remote init` makes such a pair"
            )
    if config.users_ca:
        try:
            ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_verify_locations(config.users_ca)
        except (ssl.SSLError, OSError, ValueError):
            return f"gateway.users_ca {config.users_ca} has no certificate in PEM"
    return ""


def _unreadable(key: str, path: Path) -> str:
    try:
        path.read_bytes()
    except FileNotFoundError:
        return f"gateway.{key}: there is no file {path}; `ecatctl remote init` makes it"
    except OSError as error:
        return (
            f"gateway.{key}: the gateway cannot read {path}: {error.strerror}. As a service it has "
            f"the user 'ecatd-gateway': sudo chgrp ecatd-gateway {path}; sudo chmod 640 {path}"
        )
    return ""
