"""The daemon dies, and another one takes its place: what its clients do, and what it heals."""

from collections.abc import Callable

import pytest

from conftest import Daemon
from handle import EBUSY, EDOWN, ELEASE, Handle

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

EL2008, DRIVE = 3, 0
"""Positions in the rig `troll`."""


def restart(start_daemon: Callable[..., Daemon], daemon: Daemon) -> Daemon:
    again = start_daemon("troll", "--bus", daemon.bus)
    again.bus = daemon.bus
    return again


def test_a_writer_goes_on_after_a_new_claim(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll")
    with Handle(daemon.bus) as handle:
        before = handle.instance
        output = handle.bind(EL2008, 0x7000, 1, 1)
        assert handle.claim(EL2008, 0.5) == 0
        assert handle.write(output, 1.0) == 0
        assert handle.commit() == 0
        requests = [handle.sdo_start(DRIVE, 0x1018, 1, None, 0) for _ in range(2)]
        daemon.kill_all()
        while (code := handle.commit()) == 0:
            pass
        assert (code, "the daemon has ended" in handle.error) == (ELEASE, True)
        assert handle.write(output, 1.0) == ELEASE
        assert handle.sample() == EDOWN
        assert handle.commit() == ELEASE
        daemon = restart(start_daemon, daemon)
        while (code := handle.wait(1, 1.0)) == EDOWN:
            pass
        assert code == 0
        assert handle.instance != before
        assert handle.write(output, 1.0) == ELEASE
        assert handle.commit() == ELEASE
        for request in requests:
            # One may have been answered by the daemon that is gone, but nobody had asked for it.
            assert handle.poll(request, None, 0, None, None) == EDOWN
        assert handle.claim(EL2008, 0.5) == 0
        assert handle.write(output, 1.0) == 0
        assert handle.commit() == 0
        request = handle.sdo_start(DRIVE, 0x1018, 1, None, 0)
        while (code := handle.poll(request, None, 0, None, None)) == EBUSY:
            assert handle.wait(1, 1.0) == 0
            handle.sample()
        assert code == 0
        assert handle.sample() == 0
        assert handle.value(output) == 1
    assert daemon.stop() == 0
