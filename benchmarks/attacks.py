"""What others notice while somebody attacks the gateway: `python -m benchmarks.attacks [SECONDS]`.

It prints the table of figures in SECURITY.md. Attackers, a member of the group and a user of
another machine are processes of this machine, so all come from one address, and the attackers take
the same processors.
"""

from __future__ import annotations

import os
import signal
import socket
import ssl
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import zenoh

from ecatd.client.identity import read_identity
from ecatd.operations.zenoh_keys import bus_key, session_config

from . import histogram
from .health import Health

_BUS, _PORT = "attacked", 17448
_RATE = 20.0
_CONFIG = """\
[gateway]
listen = ["tls/127.0.0.1:{port}"]
certificate = "{folder}/daemon.pem"
key = "{folder}/daemon.key"
users_ca = "{folder}/authority.pem"
[[gateway.user]]
name = "anna"
[[gateway.user]]
name = "bob"
"""


_HEAD = """\
| who attacks | exchange p99 | member of the group: answered | p99 \
| user over TLS: new sessions answered | median | memory of the gateway, at most |
|---|---|---|---|---|---|---|"""


def _settings(folder: Path, user: str) -> dict[str, Any]:
    here = {"connect/endpoints": [f"tls/127.0.0.1:{_PORT}"]}
    return {**here, **read_identity(folder / f"{user}.pem").settings}


def _sessions(folder: Path) -> None:
    """A user without rights wants 1000 sessions, 250 in each of four processes."""
    config = session_config("client", _settings(folder, "bob"))
    kept = []
    for _ in range(250):
        with suppress(zenoh.ZError):
            kept.append(zenoh.open(config))
    time.sleep(3600)


def _again(act: Callable[[], None]) -> None:
    while True:
        with suppress(OSError):
            act()
        time.sleep(1 / _RATE)


def _connect() -> socket.socket:
    return socket.create_connection(("127.0.0.1", _PORT), 1.0)


def _garbage(_: Path) -> None:
    def act() -> None:
        with _connect() as connection:
            connection.sendall(b"GET / HTTP/1.0\r\n\r\n")

    _again(act)


def _no_certificate(_: Path) -> None:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE

    def act() -> None:
        with _connect() as connection, context.wrap_socket(connection) as encrypted:
            encrypted.recv(1)

    _again(act)


def _silent(_folder: Path) -> None:
    while True:
        with ExitStack() as stack:
            for _ in range(150):
                with suppress(OSError):
                    stack.enter_context(_connect())
            time.sleep(2.0)


def _long_query(folder: Path) -> None:
    key = bus_key(_BUS, "as", "bob", "rw", "sdo", "0", "0x1000", "00")
    while True:
        with (
            suppress(zenoh.ZError),
            zenoh.open(session_config("client", _settings(folder, "bob"))) as bob,
        ):
            list(bob.get(key, payload=bytes(900_000_000), timeout=30.0))


def _slow_reader(folder: Path) -> None:
    """A user who may read asks again and again, and takes no answers."""
    key = bus_key(_BUS, "ro", "slaves")
    config = session_config("client", _settings(folder, "bob"))
    while True:
        if (pid := os.fork()) == 0:
            with suppress(zenoh.ZError):
                session = zenoh.open(config)
                for _ in range(5000):
                    session.get(key, lambda reply: None, timeout=60.0)
                os.kill(os.getpid(), signal.SIGSTOP)
            os._exit(0)
        time.sleep(4.0)
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)


_ATTACKS: dict[str, tuple[Callable[[Path], None] | None, int]] = {
    "nobody": (None, 0),
    "1000 sessions of a user without rights": (_sessions, 4),
    "20 connections a second that send garbage": (_garbage, 1),
    "20 TLS handshakes a second without certificate": (_no_certificate, 1),
    "150 silent connections, again and again": (_silent, 1),
    "queries of 900 MB by a user without rights": (_long_query, 1),
    "two sessions that ask and take no answers": (_slow_reader, 2),
}


def _gateway(daemon: int) -> int:
    """The process of the gateway, a child of the daemon."""
    for file in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            if int(file.read_text().rpartition(")")[2].split()[1]) == daemon and (
                b"ecatd.gateway" in file.with_name("cmdline").read_bytes()
            ):
                return int(file.parent.name)
    raise SystemExit("the gateway has gone")


def _attend(folder: Path, run: Path, daemon: int, seconds: float) -> list[str]:
    """Asks as both do, one request after the other; returns the cells of a row."""
    key = bus_key(_BUS, "ro", "info")
    member = {"connect/endpoints": [f"unixsock-stream/{run}/{_BUS}/gateway/zenoh"]}
    times, opened, tries = [], [], 0
    before, end, next_user = Health(_BUS), time.monotonic() + seconds, 0.0
    with zenoh.open(session_config("client", member)) as session:
        asked = 0
        while (now := time.monotonic()) < end:
            asked += 1
            if any(reply.ok for reply in session.get(key, timeout=5.0)):
                times.append(time.monotonic() - now)
            if (begin := time.monotonic()) >= next_user:
                next_user, tries = begin + 0.5, tries + 1
                with (
                    suppress(zenoh.ZError),
                    zenoh.open(session_config("client", _settings(folder, "anna"))) as anna,
                ):
                    if any(reply.ok for reply in anna.get(key, timeout=5.0)):
                        opened.append(time.monotonic() - begin)
            time.sleep(0.01)
    p99 = histogram.quantile(Health(_BUS).since(before).buckets["exchange"], 0.99)
    status = Path(f"/proc/{_gateway(daemon)}/status").read_text()
    memory = int(status.partition("VmHWM:")[2].split()[0]) / 1024
    return [
        f"{p99 / 1e3:.0f} µs",
        f"{len(times)} of {asked}",
        f"{1e3 * statistics.quantiles(times, n=100)[98]:.1f} ms" if len(times) > 1 else "–",
        f"{len(opened)} of {tries}",
        f"{1e3 * statistics.median(opened):.0f} ms" if opened else "–",
        f"{memory:.0f} MB",
    ]


def main() -> None:
    """Prints a row for each attack."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0
    with tempfile.TemporaryDirectory() as name:
        folder, run = Path(name), Path(name) / "run"
        remote = (sys.executable, "-m", "ecatd.cli", "remote")
        subprocess.run([*remote, "init", "--dir", name], check=True, stdout=subprocess.DEVNULL)
        for user in ("anna", "bob"):
            command = [*remote, "user", user, "--dir", name, "-o", f"{name}/{user}.pem"]
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        file = folder / "ecatd.toml"
        file.write_text(_CONFIG.format(port=_PORT, folder=name))
        manager = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        manager.bind(f"{name}/notify")
        manager.settimeout(120.0)
        daemon = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "ecatd.service",
                "--simulate",
                "line:4",
                "--bus",
                _BUS,
                "--config",
                str(file),
            ],
            env={**os.environ, "ECATD_RUNTIME_DIR": str(run), "NOTIFY_SOCKET": f"{name}/notify"},
            stderr=subprocess.DEVNULL,
        )
        try:
            while b"READY=1" not in manager.recv(4096):
                pass
            manager.close()
            print(_HEAD)
            for what, (attack, count) in _ATTACKS.items():
                attackers = []
                for _ in range(count):
                    attackers.append(pid := os.fork())
                    if pid == 0:
                        assert attack is not None
                        attack(folder)
                        os._exit(0)
                time.sleep(2.0)
                # Zenoh has threads, which a fork does not: each measurement is a process, too.
                if (pid := os.fork()) == 0:
                    print(
                        "| "
                        + " | ".join([what, *_attend(folder, run, daemon.pid, seconds)])
                        + " |",
                        flush=True,
                    )
                    os._exit(0)
                os.waitpid(pid, 0)
                for pid in attackers:
                    os.kill(pid, signal.SIGKILL)
                    os.waitpid(pid, 0)
        finally:
            daemon.terminate()
            daemon.wait()


if __name__ == "__main__":
    main()
