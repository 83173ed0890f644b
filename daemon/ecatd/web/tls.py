"""The certificate of the server, for addresses that other machines reach."""

from __future__ import annotations

import asyncio
import re
import ssl
import traceback
from asyncio.sslproto import SSLProtocol
from pathlib import Path
from typing import Any

from ecatd.base.errors import NotPermittedError, StateError
from ecatd.base.openssl import openssl

CERTIFICATE, KEY = Path("/etc/ecatd/tls/web.pem"), Path("/etc/ecatd/tls/web.key")
LOGINS = Path("/etc/ecatd/tls/logins")
"""Where `ecatctl remote web` and `ecatctl remote login` put their files."""
_NAME = re.compile(r"(?:DNS|IP Address):([^\s,]+)")
_REMEDY = (
    "`sudo ecatctl remote web` makes such a pair. Without one, only browsers of this machine may "
    "look; from another one: ssh -L 8570:127.0.0.1:8570 HOST ecatctl web --no-browser --port 8570"
)


def read_certificate(certificate: Path, key: Path) -> tuple[ssl.SSLContext, list[str]]:
    """Reads the certificate of the server and its key.

    Returns:
        What encrypts, and the names and addresses that the certificate is for.

    Raises:
        NotPermittedError: This user cannot read one of the files.
        StateError: There is none, or it cannot be used.
    """
    for path in (certificate, key):
        try:
            path.read_bytes()
        except FileNotFoundError as error:
            raise StateError(f"there is no file {path}: {_REMEDY}") from error
        except OSError as error:
            raise NotPermittedError(
                f"{path} cannot be read: {error.strerror}; as a service, `ecatctl web` has the "
                f"group 'ecatd-web': sudo chgrp ecatd-web {path}; sudo chmod 640 {path}"
            ) from error
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    context.set_ciphers("ECDHE+AESGCM:ECDHE+CHACHA20")
    context.options |= ssl.OP_NO_RENEGOTIATION
    context.set_alpn_protocols(["http/1.1"])
    try:
        context.load_cert_chain(certificate, key, password=lambda: b"")
        openssl("x509", "-in", certificate, "-noout", "-checkend", "0")
        names = _NAME.findall(openssl("x509", "-in", certificate, "-noout", "-ext", _EXTENSION))
    except (ssl.SSLError, OSError, ValueError) as error:
        raise StateError(f"{certificate} and {key} do not belong together: {_REMEDY}") from error
    except StateError as error:
        raise StateError(f"{certificate} has expired, or is damaged: {_REMEDY}") from error
    if not names:
        raise StateError(f"{certificate} has no names of a server (subjectAltName): {_REMEDY}")
    return context, names


_EXTENSION = "subjectAltName"


class EncryptedProtocol(SSLProtocol):
    """Encrypts a connection as the event loop does, and needs no memory after its end.

    That of the event loop has a buffer of 256 KiB for each connection, and circles of references
    from its failures, so that thousands of connections would wait for the garbage collection.

    Args:
        tls: What encrypts.
        inner: Who has what was decrypted.
        handshake_s: Seconds for the handshake.
    """

    max_size = 32 * 1024

    def __init__(self, tls: ssl.SSLContext, inner: asyncio.Protocol, handshake_s: int) -> None:
        nobody: Any = None  # waits for the handshake
        super().__init__(
            asyncio.get_running_loop(),
            inner,
            tls,
            nobody,
            server_side=True,
            ssl_handshake_timeout=handshake_s,
            ssl_shutdown_timeout=1.0,
        )

    def connection_lost(self, exc: BaseException | None) -> None:
        """See `asyncio.BaseProtocol`."""
        super().connection_lost(exc)
        if exc is not None:
            traceback.clear_frames(exc.__traceback__)
