"""The rig `two-axes` with its example configuration: two axes are homed, moved and stopped."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from conftest import Daemon
from ecatd.client import Signal

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

EXAMPLE = Path(__file__).parents[2] / "examples" / "two-axes" / "two-axes.toml"
AXES = ("x", "y")
CONTROL, STATUS, MODE, DISPLAY = 0x6040, 0x6041, 0x6060, 0x6061
TARGET, POSITION, SPEED, TORQUE = 0x607A, 0x6064, 0x606C, 0x6077
REACHED, BIT_12, BIT_13 = 0x400, 0x1000, 0x2000
PP, PV, PT, HM, CSP, CSV, CST = 1, 3, 4, 6, 8, 9, 10


class Axes:
    """A client that owns both axes."""

    def __init__(self, daemon: Daemon) -> None:
        self.client = daemon.client()
        self.claims = [self.client.claim(slave, lease=30) for slave in range(len(AXES))]

    def signal(self, axis: str, index: int) -> Signal:
        return self.client.signal(f"{axis}/0x{index:04X}:00")

    def get(self, axis: str, index: int) -> float:
        """The physical value: in m and rad."""
        return float(self.signal(axis, index).value)

    def bits(self, axis: str) -> int:
        return int(self.signal(axis, STATUS).raw)

    def put(self, axis: str, **values: float) -> None:
        names = {"word": CONTROL, "mode": MODE, "position": TARGET, "speed": 0x60FF}
        names |= {"torque": 0x6071, "probe": 0x60B8}
        for name, value in values.items():
            self.signal(axis, names[name]).value = value

    def step(self) -> None:
        self.client.wait(1, timeout=30)
        self.client.sample()
        self.client.commit()

    def until(self, condition: Callable[[], bool]) -> None:
        for _ in range(20_000):
            self.step()
            if condition():
                return
        pytest.fail(", ".join(f"{axis}: status 0x{self.bits(axis):04X}" for axis in AXES))

    def enable(self, mode: int) -> None:
        self.step()
        for axis in AXES:
            self.put(axis, mode=mode, position=self.get(axis, POSITION), speed=0, torque=0)
        for word, state in ((6, 0x21), (7, 0x23), (15, 0x27)):
            for axis in AXES:
                self.put(axis, word=word)
            self.until(lambda wanted=state: all(self.bits(a) & 0x6F == wanted for a in AXES))
        self.until(lambda: all(self.get(axis, DISPLAY) == mode for axis in AXES))

    def off(self) -> None:
        for axis in AXES:
            self.put(axis, word=0)
        self.until(lambda: all(self.bits(axis) & 0x4F == 0x40 for axis in AXES))
        self.until(lambda: not any(self.get(axis, SPEED) for axis in AXES))


@pytest.fixture(scope="module")
def daemon(start_shared: Callable[..., Daemon]) -> Daemon:
    return start_shared("two-axes", config=EXAMPLE.read_text().replace('bus = "ecat0"\n', ""))


@pytest.fixture
def axes(daemon: Daemon) -> Iterator[Axes]:
    result = Axes(daemon)
    yield result
    result.off()
    result.client.close()


def home(axes: Axes) -> None:
    axes.enable(HM)
    for axis in AXES:
        axes.put(axis, word=0x1F)
    done = REACHED | BIT_12
    axes.until(lambda: all(axes.bits(a) & (done | BIT_13) == done for a in AXES))


def test_both_are_homed_and_positioned_at_the_same_time(axes: Axes) -> None:
    """By the methods that the configuration sets: limit switch and index pulse, home switch."""
    home(axes)
    assert axes.get("x", POSITION) == pytest.approx(0, abs=0.001)
    axes.enable(PP)
    axes.put("x", position=0.05, word=0x1F)
    axes.put("y", position=-1.5, word=0x1F)
    axes.until(lambda: all(axes.bits(axis) & BIT_12 for axis in AXES))
    for axis in AXES:
        axes.put(axis, word=0x0F)
    axes.until(lambda: all(axes.bits(a) & (BIT_12 | REACHED) == REACHED for a in AXES))
    assert axes.get("x", POSITION) == pytest.approx(0.05, abs=1e-4)
    assert axes.get("y", POSITION) == pytest.approx(-1.5, abs=1e-2)


def test_a_quick_stop_keeps_its_state_until_it_is_cancelled(axes: Axes, daemon: Daemon) -> None:
    for axis in AXES:  # brake by the quick stop ramp, and stay in QUICK STOP ACTIVE
        daemon.ctl("sdo-write", axis, "0x605A", "0", "6")
    axes.enable(PV)
    axes.put("x", speed=0.05)
    axes.put("y", speed=-2)
    axes.until(lambda: axes.get("x", SPEED) > 0.045 and axes.get("y", SPEED) < -1.9)
    for axis in AXES:
        axes.put(axis, word=0x0B)
    axes.until(lambda: all(axes.bits(axis) & 0x6F == 0x07 for axis in AXES))
    axes.until(lambda: all(abs(axes.get(axis, SPEED)) < 0.01 for axis in AXES))
    for axis in AXES:
        axes.put(axis, word=0x0F, speed=0)
    axes.until(lambda: all(axes.bits(axis) & 0x6F == 0x27 for axis in AXES))
    for axis in AXES:
        daemon.ctl("sdo-write", axis, "0x605A", "0", "2")


@pytest.mark.parametrize("mode", [CSP, CSV, CST, PT])
def test_the_other_modes_move_an_axis(axes: Axes, mode: int) -> None:
    axes.enable(mode)
    here = axes.get("y", POSITION)
    values = {CSP: {"position": here + 0.1}, CSV: {"speed": 1.0}}
    axes.put("y", **values.get(mode, {"torque": 0.1}))
    axes.until(lambda: axes.get("y", POSITION) > here + 0.09)


def test_a_touch_probe_stores_the_place_of_the_home_switch(axes: Axes) -> None:
    home(axes)  # y: the home position is the edge of its home switch
    axes.enable(PP)
    axes.put("y", position=-1.0, word=0x1F)
    axes.until(lambda: bool(axes.bits("y") & BIT_12))
    axes.put("y", word=0x0F)
    axes.until(lambda: axes.bits("y") & (BIT_12 | REACHED) == REACHED)
    axes.put("y", probe=0x11)  # at the positive edge
    axes.until(lambda: int(axes.get("y", 0x60B9)) == 0x01)
    axes.put("y", position=1.0, word=0x1F)
    axes.until(lambda: int(axes.get("y", 0x60B9)) == 0x03)
    assert axes.get("y", 0x60BA) == pytest.approx(0, abs=1e-4)
    axes.put("y", probe=0)
