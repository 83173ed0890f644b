"""CAN signals in the plant as an FMU, played with FMPy in both versions of FMI."""

from __future__ import annotations

import struct
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("fmpy", reason="FMPy is not installed (extra 'test')")

sys.path.insert(0, str(Path(__file__).parents[1] / "contract"))

from can_client import CONFIG, SAFE, Others, motor
from can_messages import COMMAND, DBC, MOTOR
from fmpy.validation import validate_fmu

from conftest import Daemon, names
from player import BEAR, Model, until

pytestmark = pytest.mark.bus

CAN = "canTerminal"
STEP = 0.008
ACTIVE = 2  # EtherCAT.Types.CANState


@pytest.fixture(scope="module")
def daemon(start_shared: Callable[..., Daemon]) -> Daemon:
    return start_shared("troll-can", config=CONFIG)


@pytest.fixture(
    scope="module",
    params=[pytest.param(2, id="FMI 2"), pytest.param(3, id="FMI 3")],
)
def model(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, daemon: Daemon
) -> Model:
    folder = tmp_path_factory.mktemp("fmu")
    dbc = folder / "motor.dbc"
    dbc.write_text(DBC)
    options = ("--fmu", "--fmi", str(request.param))
    daemon.ctl("generate", "Plant", str(folder), *options, "--can", f"{CAN}={dbc}@ECU")
    dbc.unlink()
    again = daemon.ctl("generate", "Plant", str(folder), *options, "--check")
    assert again.stdout == f"{folder}/Plant.fmu: nothing would change\n"
    return Model(folder / "Plant.fmu")


@pytest.fixture
def others(daemon: Daemon) -> Iterator[Others]:
    client = Others(daemon.bus)
    client.channel.claim()
    yield client
    client.close()


def test_it_is_a_valid_fmu(model: Model) -> None:
    assert validate_fmu(str(model.path)) == []
    speed = model.variables[f"{CAN}.motor.speed"]
    assert (speed.causality, speed.unit) == ("output", "rpm")
    target = model.variables[f"{CAN}.command.target"]
    assert (target.causality, target.unit, float(target.min)) == ("input", "rad/s", -100)
    assert model.variables[f"{CAN}.command.enable"].type == "Boolean"
    assert model.variables[f"{CAN}.motor.age"].unit == "s"


def test_signals_of_other_clients(model: Model, daemon: Daemon, others: Others) -> None:
    with model.play(bus=daemon.bus, **BEAR) as player:

        def get(name: str) -> Any:
            return player.get(f"{CAN}.{name}")

        assert (get("motor.valid"), get("motor.count"), get("motor.age")) == (False, 0, 1e9)
        until(player, lambda: get("canState") == ACTIVE)
        assert get("canSendErrors") == 0
        others.send(MOTOR, motor(-12.5, 1, 50, 1.5))
        until(player, lambda: get("motor.count") == 1)
        assert get("motor.valid")
        assert (get("motor.speed"), get("motor.page"), get("motor.temperature")) == (-12.5, 1, 10)
        assert (get("motor.voltage"), get("motor.torque")) == (0, 1.5)
        assert get("motor.age") < 60
        player.fmu.terminate()
        assert player.errors() == []


def test_a_message_is_sent_from_the_first_value_on(
    model: Model, daemon: Daemon, others: Others
) -> None:
    with model.play(bus=daemon.bus, **BEAR) as player:
        player.steps(5 * STEP)
        assert player.get(f"{CAN}.command.count") == 0
        player.set(f"{CAN}.command.target", 2.5)
        until(player, lambda: player.get(f"{CAN}.command.count") == 1)
        player.set(f"{CAN}.command.enable", True)
        until(player, lambda: player.get(f"{CAN}.command.count") == 2)
        others.wait(lambda: len(others.frames(COMMAND)) == 2)
        player.fmu.terminate()
    one, other = (frame.data[:6] for frame in others.frames(COMMAND))
    assert one == struct.pack("<iBb", 2500, 0, 0)
    assert other == struct.pack("<iBb", 2500, 1, 0)


def test_a_value_beyond_its_range(model: Model, daemon: Daemon, others: Others) -> None:
    name = next(name for name in model.variables if name.startswith(f"{CAN}.command.model"))
    with model.play(bus=daemon.bus, **BEAR) as player:
        with pytest.raises(Exception, match="Set"):
            player.set(name, 6)
        names(player.errors()[-1], name, "6", "-5 to 5")
        player.set(name, -5)
        player.set(f"{CAN}.command.target", 1e9)
        until(player, lambda: player.get(f"{CAN}.command.count") >= 1)
        others.wait(lambda: others.frames(COMMAND))
        player.fmu.terminate()
    assert others.frames(COMMAND)[-1].data[:6] == struct.pack("<iBb", 100_000, 0, -5)


def test_read_only_sends_nothing(model: Model, daemon: Daemon) -> None:
    with model.play(bus=daemon.bus, readOnly=True, **BEAR) as player:
        player.set(f"{CAN}.command.target", 2.5)
        player.steps(20 * STEP)
        assert player.get(f"{CAN}.command.count") == 0
        player.fmu.terminate()


def test_the_end_in_order_needs_no_safe_frames(
    model: Model, daemon: Daemon, others: Others
) -> None:
    with model.play(bus=daemon.bus, **BEAR) as player:
        player.set(f"{CAN}.command.target", -1)
        until(player, lambda: player.get(f"{CAN}.command.count") == 1)
        others.wait(lambda: others.frames(COMMAND))
        player.fmu.terminate()
        others.send(0x123, b"")
        others.wait(lambda: others.frames(0x123))
    assert not others.frames(SAFE)


def test_without_a_bus(model: Model) -> None:
    with model.play(bus="nobody", whenMissing=3) as player:
        player.set(f"{CAN}.command.target", 1)
        player.steps(3 * STEP)
        assert not player.get(f"{CAN}.motor.valid")
        assert player.get(f"{CAN}.canState") == 1
        assert player.get(f"{CAN}.motor.age") == 1e9
