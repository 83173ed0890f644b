"""docs/zenoh-keys.md is up to date, and a real daemon sends what it says."""

import itertools
import re
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import zenoh

from conftest import Daemon, wait_for
from ecatd.operations.bus import Events, ReadRights
from ecatd.operations.catalog import OPERATIONS
from ecatd.operations.encoding import pack, unpack
from ecatd.operations.incidents import DeleteIncident, ReadIncident, RecordIncident
from ecatd.operations.operation import Failure
from ecatd.operations.registers import Data
from ecatd.operations.zenoh_keys import bus_key, session_config
from ecatdev.zenoh_keys.page import PUBLICATIONS, page
from ecatdev.zenoh_keys.types import answer_of, problems

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "zenoh-keys.md"
COMMAND = "PYTHONPATH=tools .venv/bin/python -m ecatdev.zenoh_keys.page docs/zenoh-keys.md"
RIGS = ROOT / "tests" / "rigs"

PART_READ = "ro/foe/{transfer}/0"
PUT = {"offset": 0, "data": b"four"}
WRITTEN = {"file": "new.bin", "write": True, "size": 8, "digest": 64 * "0"}
CALLS: dict[str, list[tuple[str, dict[str, Any] | None]]] = {
    "troll": [
        ("ro/stats?buckets=1", None),
        ("rw/frames/cycle", {}),
        ("ro/stream?pattern=4%2F*;hz=10", None),
        ("ro/trace?patterns=4%2F*%0A2%2F*", None),
        ("ro/sdo/0/0x6064/0", None),
        ("ro/objects/0", None),
        ("ro/objects/0/0x1018", None),
        ("ro/register/0/0x0130", None),
        ("ro/sii/0", None),
        ("rw/sdo/0/0x6060/0", {"data": b"\x08"}),
        ("rw/register/0/0x0F80", {"data": b"\1\2"}),
        ("rw/errors/all", {}),
        ("rw/sii/0", {"word": 0x3F, "data": b"\0\0"}),
        ("rw/log/dc", {"level": "debug"}),
        ("rw/outputs/hold/page", {"values": {"3/0x7000:01": "1"}, "begin": True}),
        ("rw/outputs/release/all", {}),
        ("rw/state/3", {"state": "SAFEOP"}),
        ("rw/state/3", {"state": "OP"}),
        *((kind.key, None) for kind in OPERATIONS.values() if kind.key.count("/") == 1),
    ],
    str(RIGS / "files.py"): [
        ("ro/idn/1/0/47", None),
        ("rw/idn/1/0/47", {"data": bytes(4)}),
        ("rw/foe/0", {"file": "empty.txt"}),
        ("ro/foe/{transfer}", None),
        (PART_READ, None),
        ("rw/foe/0", WRITTEN),
        ("rw/foe/{transfer}/put", PUT),
        ("rw/foe/{transfer}/cancel", {}),
    ],
    str(RIGS / "ethernet.py"): [
        ("ro/ethernet", None),
        ("rw/ip/1", {"mac": "02:00:00:00:00:01", "address": "192.168.7.2/24"}),
        ("ro/ip/1", None),
    ],
}


def fitting(key: str, patterns: Any) -> Any:
    """The pattern that a key fits."""
    (found,) = (
        item for item, text in patterns if re.fullmatch(re.sub(r"\{\w+\}", "[^/]+", text), key)
    )
    return found


def kind_of(key: str) -> Any:
    return fitting(key.partition("?")[0], [(kind, kind.key) for kind in OPERATIONS.values()])


def test_it_is_up_to_date() -> None:
    assert PAGE.read_text() == page(), f"{PAGE.name} is out of date; run: {COMMAND}"


def test_it_has_every_request_and_so_has_this_test() -> None:
    keys = [key.format(transfer=1) for calls in CALLS.values() for key, _ in calls]
    asked = {kind_of(key) for key in keys}
    others = {ReadRights, ReadIncident, RecordIncident, DeleteIncident}
    assert {*OPERATIONS.values()} - asked == others, "test_remote_users, test_incidents have them"


def test_a_difference_is_found() -> None:
    right = {"schema": 1, "data": b""}
    assert [*problems(right, Data)] == []
    for wrong in ({}, {"data": ""}, {"data": None}, {**right, "more": 1}, [], None):
        assert len([*problems(wrong, Data)]) == 1
    assert len([*problems({"events": [{}], "next": 1, "left_out": True}, Events)]) == 9


_TRIES = 3


class Caller:
    """Somebody on the machine of a daemon, who hears what is published."""

    def __init__(self, daemon: Daemon) -> None:
        path = f"{daemon.env['ECATD_RUNTIME_DIR']}/{daemon.bus}/gateway/zenoh"
        where = {"connect/endpoints": [f"unixsock-stream/{path}"]}
        self.session = zenoh.open(session_config("client", where))
        self.heard: dict[str, set[str]] = {}
        self._bus = daemon.bus
        self._numbers = itertools.count()
        self.session.declare_subscriber(bus_key(daemon.bus, "ro", "**"), self._hear)

    def _hear(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr).split("/", 3)[3]
        pattern = fitting(key, zip(PUBLICATIONS, PUBLICATIONS, strict=True))
        content = unpack(bytes(sample.payload), 1 << 26)
        self.heard.setdefault(pattern, set()).update(problems(content, PUBLICATIONS[pattern][0]))

    def ask(self, key: str, payload: dict[str, Any] | None) -> tuple[dict[str, Any], bool]:
        """Sends a query; the answer, and whether it is no error."""
        data = None
        if payload is not None:
            data = pack({"id": str(next(self._numbers)), "by": "a test", **payload})
        if "/put" in key or "/frames/" in key:
            data = pack({"id": str(next(self._numbers)), **(payload or {})})
        # On a busy machine this test takes nothing for so long that the gateway closes the
        # connection, and Zenoh makes another one. A request is carried out once, by its id.
        for _ in range(_TRIES):
            replies = [*self.session.get(bus_key(self._bus, key), payload=data, timeout=60.0)]
            if replies:
                break
        (reply,) = replies
        good = reply.ok is not None
        return unpack(bytes((reply.ok or reply.err).payload), 1 << 26), good


@pytest.mark.bus
@pytest.mark.unprivileged
@pytest.mark.parametrize("rig", CALLS, ids=lambda rig: Path(rig).stem)
def test_a_daemon_answers_as_it_says(rig: str, start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon(rig)
    caller = Caller(daemon)
    with caller.session:
        transfer = 0
        for pattern, payload in CALLS[rig]:
            key = pattern.format(transfer=transfer)
            if pattern == PART_READ:
                progress = key.removesuffix("/0")
                wait_for(lambda: caller.ask(progress, None)[0]["step"] == "done", daemon)  # noqa: B023
            answer, good = caller.ask(key, payload)
            assert good, (key, answer)
            assert [*problems(answer, answer_of(kind_of(key)), key)] == []
            transfer = answer.get("transfer", transfer)
        answer, good = caller.ask("ro/sdo/0/0x9999/0", None)
        assert not good
        assert [*problems(answer, Failure, "error")] == []


@pytest.mark.bus
@pytest.mark.unprivileged
def test_a_daemon_publishes_as_it_says(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll", config="[gateway]\nlisten = []\n")
    caller = Caller(daemon)
    with caller.session:
        caller.ask("ro/stream?pattern=4%2F*;hz=10", None)
        caller.ask("ro/trace?patterns=4%2F*", None)
        caller.ask("rw/log/dc", {"level": "debug"})
        daemon.config_file.write_text(
            "[gateway]\nlisten = []\n"
            "[[signal]]\nslave = 0\nentry = '0x6071:00'\nname = 'torque'\nmaximum = 20\n"
        )
        daemon.process.send_signal(signal.SIGHUP)
        wait_for(lambda: caller.heard.keys() == PUBLICATIONS.keys(), daemon)
    assert {key: found for key, found in caller.heard.items() if found} == {}
