"""The plug-in for python-can: what its own tests (`test_python_can_own.py`) do not have."""

import time
from collections.abc import Callable
from pathlib import Path

import can
import pytest
from test_can import CONFIG, LEFT, RIG, RIGHT

from conftest import PATIENCE, Daemon, names, wait_for

pytestmark = pytest.mark.bus

CYCLE_TIME_US = 2000


@pytest.fixture
def rig(tmp_path: Path) -> str:
    file = tmp_path / "pair.toml"
    file.write_text(RIG)
    return str(file)


def opened(daemon: Daemon, slave: int) -> can.BusABC:
    return can.Bus(interface="ecatd", channel=f"{daemon.bus}/{slave}")


def frame(identifier: int) -> can.Message:
    return can.Message(arbitration_id=identifier, is_extended_id=False)


def receive(bus: can.BusABC) -> int:
    """Identifier of the next frame but those of the daemon itself."""
    while (found := bus.recv(PATIENCE)) is not None:
        if not found.is_error_frame and found.arbitration_id >= 0x100:
            return found.arbitration_id
    raise AssertionError("no frame came")


def test_an_error_frame_is_not_sent(start_daemon: Callable[..., Daemon], rig: str) -> None:
    """`can.bridge` passes them on; a terminal would send a frame with such an identifier."""
    daemon = start_daemon(rig, config=CONFIG)
    with opened(daemon, LEFT) as left, opened(daemon, RIGHT) as right:
        left.send(can.Message(arbitration_id=0x104, is_error_frame=True, dlc=8, data=bytes(8)))
        left.send(frame(0x100))
        assert receive(right) == 0x100


def test_the_state_is_not_that_of_a_daemon_that_has_ended(
    start_daemon: Callable[..., Daemon], rig: str
) -> None:
    """Also for a program that only looks, and the first look after the restart."""
    daemon = start_daemon(rig, config=CONFIG)
    with opened(daemon, LEFT) as bus:
        wait_for(lambda: bus.state == can.BusState.ACTIVE, daemon)
        daemon.kill_all()
        end = time.monotonic() + PATIENCE
        while bus.state != can.BusState.ERROR:
            assert time.monotonic() < end
        again = start_daemon(rig, "--bus", daemon.bus, config=CONFIG)
        wait_for(lambda: bus.state == can.BusState.ACTIVE, again)


def test_wrong_arguments_are_refused_when_the_bus_is_opened(
    start_daemon: Callable[..., Daemon], rig: str
) -> None:
    daemon = start_daemon(rig, config=CONFIG)
    for lease in (-1, "x"):
        with pytest.raises(can.CanInitializationError, match="lease"):
            can.Bus(interface="ecatd", channel=f"{daemon.bus}/{LEFT}", lease=lease)
    with pytest.raises(can.CanInitializationError) as error:
        can.Bus(interface="ecatd", channel=daemon.bus)
    names(error.value, daemon.bus, "ecat0/6")


def test_buses_go_on_after_a_restart(start_daemon: Callable[..., Daemon], rig: str) -> None:
    daemon = start_daemon(rig, config=CONFIG)
    with opened(daemon, LEFT) as first, opened(daemon, LEFT) as second:
        first.send(frame(0x101))
        assert receive(second) == 0x101
        daemon.stop()
        with pytest.raises(can.CanOperationError):
            first.send(frame(0x102))
        start_daemon(rig, "--bus", daemon.bus, config=CONFIG)
        # It is the first sender of the new daemon, as the other one was of the old daemon: its
        # frames are not taken for those of the other.
        second.send(frame(0x103))
        assert receive(first) == 0x103
        first.send(frame(0x104))
        assert receive(second) == 0x104
