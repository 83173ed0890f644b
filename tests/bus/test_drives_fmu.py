"""Drives in SI units in the FMU of a bus: two axes home, move and stop, run with FMPy."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from fmpy.validation import validate_fmu

from conftest import PATIENCE, Daemon, names
from player import Model, Player

pytestmark = pytest.mark.bus

EXAMPLES = Path(__file__).parents[2] / "examples" / "two-axes"
CYCLE_TIME_US = 1000
CONTINUE = 3
BEAR = {"whenMissing": CONTINUE, "whenFailed": CONTINUE, "lease": 2.0}
SWITCHED_OFF, OPERATION, QUICK_STOP = (2, 3), 5, 6
VELOCITY = 5


@pytest.fixture(scope="module")
def daemon(start_shared: Callable[..., Daemon]) -> Daemon:
    return start_shared("two-axes", config=(EXAMPLES / "two-axes.toml").read_text())


@pytest.fixture(scope="module", params=[2, 3])
def model(
    daemon: Daemon, tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest
) -> Model:
    folder = tmp_path_factory.mktemp("fmu")
    daemon.ctl("generate", "Plant", str(folder), "--fmu", "--fmi", str(request.param))
    return Model(folder / "Plant.fmu")


@pytest.fixture
def player(model: Model, daemon: Daemon) -> Iterator[Player]:
    with model.play(bus=daemon.bus, **BEAR) as found:
        yield found


def until(player: Player, condition: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, player.said
        player.step()


def test_the_variables_are_in_si_units(model: Model) -> None:
    assert validate_fmu(str(model.path)) == []
    position, reference = (model.variables[f"x.drive.{n}"] for n in ("position", "speedReference"))
    assert (position.causality, position.unit) == ("output", "m")
    assert (reference.causality, reference.unit) == ("input", "m/s")
    assert model.variables["y.drive.positionReference"].unit == "rad"
    assert model.variables["y.drive.mode"].declaredType.name == "DriveMode"


def test_two_axes_home_move_and_stop(player: Player) -> None:
    def get(name: str) -> Any:
        return player.get(name)

    def both(name: str, value: Any) -> None:
        for axis in ("x", "y"):
            player.set(f"{axis}.drive.{name}", value)

    player.step()
    assert get("x.drive.state") in SWITCHED_OFF
    both("enable", True)
    until(player, lambda: get("x.drive.enabled") and get("y.drive.enabled"))
    both("home", True)
    until(player, lambda: get("x.drive.homed") and get("y.drive.homed"))
    assert not get("x.drive.enabled"), "it does not follow its reference"
    both("home", False)
    until(player, lambda: get("x.drive.enabled") and get("y.drive.enabled"))
    player.set("x.drive.positionReference", 0.02)
    player.set("y.drive.positionReference", 1.0)
    player.step()
    until(player, lambda: get("x.drive.reached") and get("y.drive.reached"))
    assert get("x.drive.position") == pytest.approx(0.02, abs=2e-4)
    assert get("y.drive.position") == pytest.approx(1.0, abs=0.02)
    player.set("y.drive.quickStop", True)
    until(player, lambda: get("y.drive.state") != OPERATION)
    player.set("y.drive.quickStop", False)
    player.steps(0.3)
    assert not get("y.drive.enabled"), "it waits for an edge of enable"
    player.set("y.drive.enable", False)
    player.steps(0.02)
    player.set("y.drive.enable", True)
    until(player, lambda: get("y.drive.enabled"))
    both("enable", False)
    until(player, lambda: get("x.drive.state") in SWITCHED_OFF)
    player.fmu.terminate()
    assert player.errors() == []


def test_a_raw_input_has_no_effect_beside_the_drive(player: Player) -> None:
    name = "x.controlword" if "x.controlword" in player.model.variables else "x.controlWord"
    player.set("x.drive.enable", True)
    player.set(name, 0)
    assert player.warnings()
    names(player.warnings()[-1], name, "no effect", "drive")
    until(player, lambda: player.get("x.drive.enabled"))
    assert player.get(name) == 0x0F
    player.fmu.terminate()


def test_a_speed_is_followed(player: Player) -> None:
    player.set("y.drive.mode", VELOCITY)
    player.set("y.drive.enable", True)
    until(player, lambda: player.get("y.drive.enabled"))
    player.set("y.drive.speedReference", 2.0)
    until(player, lambda: abs(player.get("y.drive.speed") - 2.0) < 0.1)
    with pytest.raises(Exception, match="fmi"):
        player.set("y.drive.mode", 9)
    names(player.errors()[-1], "y.drive.mode", "9")
    player.set("y.drive.enable", False)
    until(player, lambda: abs(player.get("y.drive.speed")) < 0.1)
    player.fmu.terminate()


def test_units_that_contradict_each_other_are_named(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    """The raw variables are there, and those of the other drive."""
    first, entry, rest = (EXAMPLES / "two-axes.toml").read_text().partition('entry = "0x607A:00"')
    assert entry
    daemon = start_daemon(
        "two-axes", config=first + entry + rest.replace("scale = ", "scale = 2", 1)
    )
    said = daemon.ctl("generate", "Plant", str(tmp_path), "--fmu")
    names(said.stdout + said.stderr, "slave 0", "0x6064:00", "0x607A:00", "[[signal]]")
    variables = Model(tmp_path / "Plant.fmu").variables
    assert "x.drive.enable" not in variables
    assert "y.drive.enable" in variables
