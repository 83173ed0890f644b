"""Finds out why no connection to an endpoint of another machine was made."""

from __future__ import annotations

import os
import socket
import ssl

from ecatd.base.errors import (
    EcatError,
    NoAnswerError,
    NotPermittedError,
    UnreachableError,
    UsageError,
)
from ecatd.base.timeouts import Timeout
from ecatd.operations.endpoints import Endpoint

from .identity import Identity

_TLS = "tls"
_LOOKED_AT = ("tcp", _TLS)
_PATIENCE_S = 5.0
"""Most seconds for each of the steps: the connection, the handshake, and its answer."""
_REFUSED = {
    "CERTIFICATE_EXPIRED": "it has expired",
    "CERTIFICATE_UNKNOWN": "it has expired, or is not one for users",
    "UNKNOWN_CA": "another authority has signed it than the daemon trusts (gateway.users_ca)",
    "DECRYPT_ERROR": "another authority has signed it than the daemon trusts (gateway.users_ca)",
    "CERTIFICATE_REQUIRED": "the connection had none",
}
"""What a daemon says about the certificate of a user (RFC 8446, section 6.2), in words."""


def why_no_connection(endpoint: str, identity: Identity | None, timeout: float) -> EcatError:
    """Why Zenoh has made no connection: absent, silent, or not permitted.

    Args:
        endpoint: The endpoint, such as `tls/host:7448`.
        identity: The certificate of the user; None: none.
        timeout: Most seconds for each step of finding out.
    """
    place = Endpoint.of(endpoint)
    protocol, host, port = place.protocol, place.host, place.port
    nobody = f"no ecatd answers at {endpoint}"
    if protocol not in _LOOKED_AT or not port.isdecimal():
        return UnreachableError(
            f"{nobody}; start ecatd there, and check the address and "
            "`gateway.listen` of its configuration"
        )
    changed_by = "--timeout" if timeout < _PATIENCE_S else ""
    patience = Timeout(min(timeout, _PATIENCE_S), changed_by)
    try:
        connection = socket.create_connection((host, int(port)), patience.seconds)
    except TimeoutError:
        return UnreachableError(
            f"{nobody}: the machine '{host}' does not answer at all within {patience}"
        )
    except (OSError, UnicodeError, OverflowError) as error:
        why = getattr(error, "strerror", None) or str(error)
        return UnreachableError(
            f"{nobody}: {why}; start ecatd there, and check the address and "
            "`gateway.listen` of its configuration"
        )
    with connection:
        if protocol == _TLS:
            return _shake_hands(connection, host, endpoint, identity, patience)
        return _silent(endpoint, patience)


def _silent(endpoint: str, patience: Timeout) -> EcatError:
    return NoAnswerError(
        f"somebody listens at {endpoint}, but does not answer as ecatd does within {patience}: the "
        f"gateway is busy or hangs, or another program has this port"
    )


def _shake_hands(
    connection: socket.socket,
    host: str,
    endpoint: str,
    identity: Identity | None,
    patience: Timeout,
) -> EcatError:
    """Tries the certificates of both sides."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    if identity is None:
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    else:
        try:
            _load(context, identity)
            context.load_verify_locations(cadata=identity.authorities)
        except (OSError, ValueError) as error:
            return UsageError(f"{identity.path} cannot be used: {error}; {_shown(identity)}")
    try:
        with context.wrap_socket(connection, server_hostname=host) as tls:
            tls.recv(1)  # the daemon looks at the certificate of the user only now (TLS 1.3)
    except ssl.SSLCertVerificationError as error:
        return NotPermittedError(
            f"the certificate of the daemon at {endpoint} is not to be trusted: "
            f"{error.verify_message}. It must be made for the name '{host}', and your identity "
            f"must have its authority: {_shown(identity)}"
        )
    except TimeoutError:
        return _silent(endpoint, patience)
    except (OSError, ValueError) as error:  # of which ssl.SSLError is one
        name = getattr(error, "reason", None) or ""
        if "ALERT" not in name:  # it does not speak TLS
            return _silent(endpoint, patience)
        if identity is None:
            return NotPermittedError(
                f"{endpoint} needs a certificate. Ask for one (`ecatctl remote user NAME` on the "
                "machine of the daemon), and give it with --identity"
            )
        why = next((text for part, text in _REFUSED.items() if part in name), name.lower())
        return NotPermittedError(
            f"the daemon at {endpoint} does not accept the certificate of user "
            f"'{identity.user}': {why}; {_shown(identity)}"
        )
    return UnreachableError(
        f"{endpoint} ends the connection: no ecatd listens there, or it does not let "
        f"{f'user {identity.user!r}' if identity else 'anybody'} in"
    )


def _load(context: ssl.SSLContext, identity: Identity) -> None:
    """Takes certificate and key; of a locked file, the key is open in this process only."""
    with os.fdopen(os.memfd_create("identity"), "wb") as pair:
        pair.write(f"{identity.certificate}\n{identity.key}".encode())
        pair.flush()
        context.load_cert_chain(f"/proc/self/fd/{pair.fileno()}")


def _shown(identity: Identity | None) -> str:
    return f"`ecatctl remote show {identity.path}` shows yours" if identity else "--identity"
