"""Outputs by hand: somebody over Zenoh holds outputs, and must say so again in time."""

import asyncio
import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from conftest import Daemon, naming, wait_for
from ecatd.base.errors import BusyError, LeaseError, OwnedError, StateError, UsageError
from ecatd.client.remote import Remote
from ecatd.operations.outputs import HoldOutputs, Place, ReadOutputs, ReleaseOutputs
from ecatd.server.requests.hands import _Process

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

FIRST, SECOND, OF_DRIVE = "3/0x7000:01", "3/0x7010:01", "0/0x60FF:00"
CONFIG = """audit_file = "{audit}"
[gateway]
listen = []
"""


@pytest.fixture
def daemon(start_daemon: Callable[..., Daemon], tmp_path: Path) -> Daemon:
    return start_daemon("troll", config=CONFIG.format(audit=tmp_path / "audit"))


@pytest.fixture
def remote(daemon: Daemon, monkeypatch: pytest.MonkeyPatch) -> Iterator[Remote]:
    monkeypatch.setenv("ECATD_RUNTIME_DIR", daemon.env["ECATD_RUNTIME_DIR"])
    with Remote(daemon.bus, timeout=30) as remote:
        yield remote


def outputs(remote: Remote) -> dict[str, Any]:
    found = remote.request(ReadOutputs())
    return {
        row["name"]: row | {"client": found["owners"][row["owner"]] if row["owner"] >= 0 else {}}
        for row in found["outputs"]
    }


def begin_to_hold(remote: Remote, writer: str, values: dict[str, Any]) -> None:
    for left in reversed(range(10)):
        ticket = remote.request(HoldOutputs(writer, values, begin=True))["ticket"]
        try:
            remote.request(HoldOutputs(writer, values, ticket=ticket))
        except LeaseError:  # a busy machine was slower than the ticket
            if left == 0:
                raise
        else:
            return


def test_outputs_are_held_as_long_as_somebody_says_so(
    daemon: Daemon, remote: Remote, tmp_path: Path
) -> None:
    with daemon.client() as local:

        def hold(writer: str = "page", *, begin: bool = False, **values: Any) -> None:
            named = {
                {"first": FIRST, "second": SECOND, "drive": OF_DRIVE}[k]: v
                for k, v in values.items()
            }
            if begin:
                begin_to_hold(remote, writer, named)
            else:
                remote.request(HoldOutputs(writer, named))

        def renew_until(condition: Callable[[], bool], **values: Any) -> None:
            deadline = time.monotonic() + 20
            while not condition():
                hold(**values)
                assert time.monotonic() < deadline

        with pytest.raises(LeaseError, match=naming("'page'", "begin")):
            hold(first="1")
        hold(first="1", second=None, begin=True)
        renew_until(lambda: outputs(remote)[FIRST]["value"] == 1, first=None, second=None)
        seen = outputs(remote)
        assert (seen[FIRST]["state"], seen[SECOND]["state"]) == ("active", "claimed")
        client = seen[FIRST]["client"]
        assert (client["by_hand"], client["lease_ms"]) == (True, 250)
        assert client["name"] == f"hand:{client['user']}"
        hold(first=None, second=None)
        # A request for a ticket moves nothing, also not what this writer holds.
        remote.request(HoldOutputs("page", {FIRST: "0", SECOND: "1"}, begin=True))
        seen = outputs(remote)
        assert (seen[FIRST]["value"], seen[SECOND]["value"]) == (1, 0)
        hold(first=None, second=None)
        # Nobody takes an output from its owner: neither a program, nor another hand.
        with pytest.raises(OwnedError, match=naming("hand:")):
            local.claim(local.signal(3, 0x7000, 1))
        with pytest.raises(OwnedError, match=naming("hand:")):
            hold("other", begin=True, first="0")
        # Whatever is wrong, the rest stays as it is, for another 250 ms.
        hold(first=None, second=None)
        for wrong, tokens in (("on", "0x7000:01 | 'on'"), ("0.5", "whole"), (2, "0x7000:01 | 2")):
            with pytest.raises(UsageError, match=naming(*tokens.split(" | "))):
                hold(first=wrong, second=None)
        hold(second="1")  # and so releases the first one
        renew_until(lambda: outputs(remote)[SECOND]["value"] == 1, second=None)
        assert outputs(remote)[FIRST]["cause"] == "released"
        # A hand that is silent has let go, and its late requests move nothing.
        wait_for(lambda: outputs(remote)[SECOND]["owner"] == -1, daemon)
        wait_for(lambda: outputs(remote)[SECOND]["value"] == 0, daemon)
        with pytest.raises(LeaseError, match=naming("250 ms")):
            hold(second="1")
        hold(drive="1234", begin=True)
        released = remote.request(ReleaseOutputs(None))
        assert released["outputs"] == [OF_DRIVE]
        assert outputs(remote)[OF_DRIVE]["owner"] == -1
        with pytest.raises(StateError, match=naming("no output", "0x1234:00")):
            remote.request(HoldOutputs("page", {"0/0x1234:00": 1}, begin=True))
        # What waited on its way moves nothing: its ticket is of another time, or of another writer.
        ticket = remote.request(HoldOutputs("page", {FIRST: "1"}, begin=True))["ticket"]
        for late in (
            HoldOutputs("other", {FIRST: "1"}, ticket=ticket),
            HoldOutputs("page", {FIRST: "1"}, ticket="of-yesterday"),
            HoldOutputs("page", {FIRST: "1"}),
        ):
            with pytest.raises(LeaseError, match=naming("ticket")):
                remote.request(late)
        time.sleep(0.3)
        with pytest.raises(LeaseError, match=naming("ticket")):
            remote.request(HoldOutputs("page", {FIRST: "1"}, ticket=ticket))
        # What the page says is one line for each change, and none for a renewal.
        lines = (tmp_path / "audit").read_text().splitlines()
    about = [line for line in lines if "0x7000:01" in line and "has failed" not in line]
    assert len(about) == 2, lines
    assert "changed to 1 by" in about[0]
    assert "released" in about[1]
    assert any("0x7010:01" in line and "no renewal came for 250 ms" in line for line in lines)
    assert any("has failed" in line and "hand:" in line for line in lines)


def test_a_renewal_of_what_has_been_let_go_begins_nothing(daemon: Daemon) -> None:
    """The bus server may not have heard of a lapse yet, while the process has let go already."""
    place = Place.of(FIRST)

    async def late() -> None:
        process = await _Process.start(daemon.bus, lambda _: None, lambda _: None)
        holding = {"holding": 1, "program": "hand:x", "lease": 0.25, "outputs": [[*place, 1]]}
        try:
            with pytest.raises(LeaseError):
                await process.ask(holding | {"begins": False})
            await process.ask(holding | {"begins": True})
            await process.ask({"holding": 1, "release": True})
            with pytest.raises(LeaseError):
                await process.ask(holding | {"begins": False})
        finally:
            process.close()

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ECATD_RUNTIME_DIR", daemon.env["ECATD_RUNTIME_DIR"])
        asyncio.run(late())


def test_places_are_limited_and_a_killed_hand_lets_go(daemon: Daemon, remote: Remote) -> None:
    names = [f"3/0x70{n}0:01" for n in range(5)]

    def begin(number: int) -> None:
        begin_to_hold(remote, f"page {number}", {names[number]: 1})

    def is_full() -> bool:
        try:
            begin(4)
        except BusyError:
            return True
        remote.request(ReleaseOutputs(None))
        return False

    def hold_four() -> bool:
        for number in range(4):
            begin(number)
        return is_full()

    wait_for(hold_four, daemon)  # on a busy machine the first one may have lapsed meanwhile
    remote.request(ReleaseOutputs("page 0"))
    remote.request(ReleaseOutputs("page 1"))
    begin(0)
    client = outputs(remote)[names[0]]["client"]
    os.kill(client["pid"], signal.SIGKILL)
    wait_for(lambda: outputs(remote)[names[0]]["owner"] == -1, daemon)
    begin(0)  # another process does it
    assert outputs(remote)[names[0]]["client"]["pid"] != client["pid"]
