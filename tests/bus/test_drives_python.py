"""Axes in Python: enabled, homed, moved and stopped, over the real bus."""

import gc
import os
import signal
import subprocess
import sys
import textwrap
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from conftest import Daemon, names, wait_for
from ecatd.base.errors import LeaseError, NoAnswerError, OwnedError, StateError, UsageError
from ecatd.client.axis_status import DriveState, Homing
from ecatd.client.drives import DriveError, Drives
from ecatsim.control import Simulator

RIG = """
from ecatsim.devices.drive import Drive
from ecatsim.devices.generic_drive import CiA402Drive
from ecatsim.rig import Rig
from ecatd.etg.datatypes import DataType
from ecatsim.slave.objects import Access

def rig():
    drives = [CiA402Drive(encoder=10000), CiA402Drive(encoder=10000)]
    for drive in drives:
        drive.dictionary.variable(0x2100, "Break encoder", DataType.UNSIGNED8, 0, Access.RW)
        drive.dictionary[0x2100, 0].on_write = lambda value, d=drive: d.break_encoder(bool(value))
    return Rig("two", drives)
"""
CYCLE_TIME_US = 2000
SCALE = 6.283185307179586e-4


def configuration() -> str:
    lines = []
    for number, name in enumerate("xy"):
        lines.append(f'[[slave]]\nposition = {number}\nname = "{name}"\n')
    for number in range(2):
        for entry, unit in (("6064", "rad"), ("607A", "rad"), ("606C", "rad/s"), ("60FF", "rad/s")):
            lines.append(
                f'[[signal]]\nslave = {number}\nentry = "0x{entry}:00"\nunit = "{unit}"\n'
                f"scale = {SCALE}\n"
            )
    return "".join(lines)


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("axes") / "two.py"
    file.write_text(RIG)
    return file


@pytest.fixture(scope="module")
def daemon(start_shared: Callable[..., Daemon], rig: Path) -> Daemon:
    return start_shared(str(rig), config=configuration())


@pytest.fixture
def axes(daemon: Daemon) -> Iterator[Drives]:
    # A lease of 2 s is more than the default: machines are busy.
    with daemon.client() as bus, bus.drives("x", "y", lease=2) as drives:
        yield drives


def test_two_axes_home_move_and_stop(axes: Drives) -> None:
    x, y = axes
    assert x.status.state in (DriveState.SWITCH_ON_DISABLED, DriveState.READY_TO_SWITCH_ON)
    axes.enable()
    axes.home(methods=[35, 37])
    assert x.status.homing == Homing.HOMED
    assert x.position == pytest.approx(0, abs=0.02)
    axes.move_to(None, [1.0, 2.0], speed=4.0, acceleration=20.0)
    assert (x.position, y.position) == (pytest.approx(1, abs=0.02), pytest.approx(2, abs=0.02))
    x.run(5.0)
    x.wait_reached()
    assert x.status.speed == pytest.approx(5, abs=0.5)
    assert y.position == pytest.approx(2, abs=0.02)
    x.move_to(0.5, speed=10)
    assert x.position == pytest.approx(0.5, abs=0.02)
    axes.stop()
    assert x.status.state != DriveState.OPERATION_ENABLED
    names(x.explain(), "axis x", "quick stop", "enable")
    axes.enable()
    x.move_by(-0.25)
    axes.disable()
    assert x.status.state == DriveState.READY_TO_SWITCH_ON


def test_what_cannot_be_is_refused(axes: Drives, daemon: Daemon) -> None:
    x, _ = axes
    with pytest.raises(DriveError) as error:
        x.move_to(1.0)
    names(error.value, "axis x", "enable it first")
    axes.enable()
    with pytest.raises(DriveError) as error:
        x.home(-77)
    names(error.value, "axis x", "-77", "0x60E3", "35")
    with pytest.raises(UsageError):
        x.move_to(float("nan"))
    with pytest.raises(UsageError):
        x.move_to(1.0, speed=0)
    with pytest.raises(UsageError):
        axes.move_to(None, [1.0])
    with pytest.raises(UsageError):
        x.limit(speed=1)
    with daemon.client() as bus:
        with pytest.raises(OwnedError), bus.drive("x"):
            pass
        with pytest.raises(StateError):
            bus.drive("z")
    axes.disable()


def test_an_axis_without_a_unit_says_what_to_write(
    start_daemon: Callable[..., Daemon], rig: Path
) -> None:
    daemon = start_daemon(str(rig), config='[[slave]]\nposition = 0\nname = "x"\n')
    with daemon.client() as bus:
        with pytest.raises(UsageError) as error, bus.drive("x"):
            pass
        names(error.value, "axis x", "0x6064", "[[signal]]")
        axis = bus.drive("x", lease=2)
        axis.units(position=SCALE)
        with axis:
            axis.enable()
            start = axis.position
            axis.move_by(1.0, speed=5)
            assert axis.position == pytest.approx(start + 1, abs=0.02)


def test_limits_are_observed(daemon: Daemon) -> None:
    with daemon.client() as bus:
        axis = bus.drive("y", lease=2)
        axis.limit(position=(-1.0, 1.0), speed=3.0)
        with axis:
            axis.enable()
            axis.home(37)
            with pytest.raises(NoAnswerError) as error:
                axis.move_to(5.0, speed=50, timeout=3)
            names(error.value, "axis y", "not at its target")
            assert axis.position == pytest.approx(1.0, abs=0.05)
            assert axis.status.limited
            axis.disable()


def test_nothing_moves_when_an_axis_is_enabled_beyond_its_limits(daemon: Daemon) -> None:
    with daemon.client() as bus:
        with bus.drive("y", lease=2) as axis:
            axis.enable()
            axis.home(37)
            axis.move_to(2.0, speed=10)
        axis = bus.drive("y", lease=2)
        axis.limit(position=(-1.0, 1.0), speed=2.0)
        with axis:
            target = bus.signal("y/0x607A:00")
            axis.enable()
            start = axis.position
            for _ in range(20):
                bus.wait(timeout=30)
                bus.sample()
                assert target.value == pytest.approx(start, abs=0.01)
            axis.move_to(0.9, speed=2.0, timeout=60)
            assert axis.position == pytest.approx(0.9, abs=0.02)
            axis.run(2.0)
            wait_for(lambda: axis.status.limited and abs(axis.status.speed) < 0.05, daemon)
            assert axis.position < 1.05, "it brakes before the limit"


def test_an_enable_that_has_failed_does_not_take_effect_later(daemon: Daemon) -> None:
    with (
        Simulator(str(daemon.child_pid("ecatsim"))) as simulator,
        daemon.client() as bus,
        bus.drive("x", lease=2) as axis,
    ):
        axis.enable()
        simulator.faults.power_off(0)
        wait_for(lambda: not axis.status.connected, daemon)
        with pytest.raises((NoAnswerError, DriveError)):
            axis.enable(timeout=0.5)
        simulator.faults.power_on(0)
        wait_for(lambda: axis.status.connected, daemon)
        for _ in range(100):
            axis._group.wait()
            assert axis.status.state != DriveState.OPERATION_ENABLED
        axis.enable(timeout=30)


def test_a_daemon_that_comes_back_with_other_units_is_refused(
    start_daemon: Callable[..., Daemon], rig: Path
) -> None:
    daemon = start_daemon(str(rig), config=configuration())
    with daemon.client() as bus, bus.drive("x", lease=2) as axis:
        axis.enable()
        daemon.stop()
        other = configuration().replace(f"scale = {SCALE}", "scale = 0.01")
        again = start_daemon(str(rig), "--bus", daemon.bus, config=other)
        wait_for(lambda: axis._group.state(0).code != 0, again)
        with pytest.raises(StateError) as error:
            axis.enable(timeout=30)
        names(error.value, "axis x", "other units", "open it again")


@pytest.mark.parametrize(
    "limit",
    [
        {"speed": 0},
        {"position": (1, -1)},
        {"position": 0.1},
        {"following_error": -1},
        {"torque": 1},
    ],
)
def test_limits_that_are_none_are_refused(daemon: Daemon, limit: dict[str, Any]) -> None:
    with daemon.client() as bus:
        axis = bus.drive("x")
        with pytest.raises(UsageError):
            axis.limit(**limit)


def test_targets_between_two_positions_of_a_slow_program(axes: Drives, daemon: Daemon) -> None:
    """At some 50 Hz: the target position of the drive makes no steps, and ends where it shall."""
    x, _ = axes
    axes.enable()
    start = x.position
    axes.follow([x], [start], 0.02)
    x.wait_reached()
    with daemon.client() as bus:
        target = bus.signal("x/0x607A:00")
        bus.sample()
        seen = [target.value]
        for number in range(1, 21):
            axes.follow([x], [start + 0.05 * number], 0.02)
            for _ in range(10):  # cycles of 2 ms
                bus.wait(timeout=30)
                bus.sample()
                seen.append(target.value)
        x.wait_reached()
        bus.sample()
        assert target.value == pytest.approx(start + 1.0, abs=2 * SCALE)
    steps = [after - before for before, after in pairwise(seen)]
    # A tenth of the way in each cycle; a busy machine may miss some of them.
    usual = sorted(abs(step) for step in steps if step)[len([s for s in steps if s]) // 2]
    assert usual == pytest.approx(0.005, abs=2 * SCALE)
    axes.disable()


def test_a_fault_stops_the_other_axis_and_needs_a_reset(axes: Drives, daemon: Daemon) -> None:
    x, y = axes
    axes.enable()
    y.run(3.0)
    daemon.ctl("sdo-write", "x", "0x2100", "0", "1")
    wait_for(lambda: not (x.status.enabled or y.status.enabled), daemon)
    names(x.explain(), "axis x", "fault", "0x7305", "encoder")
    wait_for(lambda: abs(y.status.speed) < 0.1, daemon)
    with pytest.raises(DriveError) as error:
        axes.enable()
    names(error.value, "axis x", "fault", "reset")
    daemon.ctl("sdo-write", "x", "0x2100", "0", "0")
    axes.reset()
    axes.enable()
    axes.disable()


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_an_axis_stops_when_its_program_does(daemon: Daemon, how: int) -> None:
    text = f"""
        import time
        from ecatd.client import Client
        with Client({daemon.bus!r}) as bus, bus.drive("x", lease=0.5) as x:
            x.enable()
            x.run(3.0)
            while abs(x.status.speed - 3) > 0.5:
                time.sleep(0.01)
            print("runs", flush=True)
            time.sleep(1000)
    """
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(text)],
        env=daemon.env,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "runs\n"
        os.kill(process.pid, how)
        with daemon.client() as bus:
            speed = bus.signal("x/0x606C:00")
            status = bus.signal("x/0x6041:00")
            while int(status.raw) & 0x6F == 0x27 or abs(speed.value) > 0.1:
                bus.wait(timeout=30)
                bus.sample()
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def test_axes_that_a_program_forgets_do_not_go_on(daemon: Daemon) -> None:
    with daemon.client() as bus:
        axis = bus.drive("x", lease=2)
        axis.__enter__()
        axis.enable()
        axis.run(3.0)
        axis.wait_reached()
        del axis
        gc.collect()
        status = bus.signal("x/0x6041:00")
        while int(status.raw) & 0x6F == 0x27:
            bus.wait(timeout=30)
            bus.sample()


def test_after_a_restart_of_the_daemon_an_axis_waits_for_enable(
    start_daemon: Callable[..., Daemon], rig: Path
) -> None:
    daemon = start_daemon(str(rig), config=configuration())
    with daemon.client() as bus, bus.drive("x", lease=2) as axis:
        axis.enable()
        axis.run(2.0)
        daemon.stop()
        again = start_daemon(str(rig), "--bus", daemon.bus, config=configuration())
        wait_for(lambda: axis.status.connected, again)
        names(axis.explain(), "axis x", "enable", "lost")
        with pytest.raises((DriveError, LeaseError)):
            axis.run(1.0)
        axis.enable(timeout=30)
        axis.move_by(0.1)
