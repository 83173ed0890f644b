"""Who owns an output, for how long, and what is said when that ends; with the C client."""

import ctypes
from collections.abc import Callable

import pytest

from conftest import Daemon, wait_for
from handle import EOWNED, Handle

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

DRIVE, EL2008 = 0, 3


CONFIG = "[gateway]\nlisten = []\n[outputs]\nlease_cycles = 7\nlease_max_ms = 50000\n"


def lease(daemon: Daemon, slot: int = 0) -> float:
    """The lease in force in seconds, as everybody may see it."""
    rows = {row["slot"]: row for row in daemon.ctl_json("claims")["slots"]}
    return float(rows[slot]["lease_us"]) / 1e6


def test_the_lease_is_that_of_what_is_owned(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll", config=CONFIG)
    with Handle(daemon.bus) as client, Handle(daemon.bus) as other:
        lamps = [client.bind(EL2008, 0x7000 + 16 * n, 1, 1) for n in range(3)]
        assert client.claim_entry(lamps[0], 20.0) == 0
        assert lease(daemon) == 20
        assert client.claim(DRIVE, 70.0) == 0
        assert lease(daemon) == 50  # more is cut
        assert client.release(DRIVE) == 0
        assert lease(daemon) == 20
        assert client.claim_entry(lamps[0], 10.0) == 0  # is owned, and not for a shorter time
        assert lease(daemon) == 20
        assert client.claim_entry(lamps[0], 30.0) == 0
        assert lease(daemon) == 30
        # What is refused changes nothing.
        assert other.claim_entry(lamps[1], 40.0) == 0
        wanted = (ctypes.c_int * 2)(lamps[2], lamps[1])
        assert client.claim_entries(wanted, ctypes.c_size_t(2), 50.0) == EOWNED
        wait_for(lambda: lease(daemon) == 30, daemon)
        assert client.release_entry(lamps[0]) == 0
        assert client.claim_entry(lamps[0], 0.0001) == 0
        assert lease(daemon) == 0.007  # less is not granted
