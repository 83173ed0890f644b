"""An FMU and its bus: another one, none, one that ends and comes back, in each mode."""

import threading
import uuid
from collections.abc import Callable
from pathlib import Path

import pytest

pytest.importorskip("fmpy", reason="FMPy is not installed (extra 'test')")

from conftest import Daemon, names
from ecatd.description import bus_file
from ecatd.description.bus import Bus, Slave
from ecatgen.fmu import generate_fmu
from player import BEAR, Model, Player, outputs, plant_of, until

pytestmark = [pytest.mark.bus, pytest.mark.long]

ERROR, WAIT, CONTINUE = 1, 2, 3  # EtherCAT.Types.BusFailure
MISSING, OPERATIONAL = 1, 5  # EtherCAT.Types.BusState
NOT_AVAILABLE = 1  # EtherCAT.Types.ALState


@pytest.fixture(scope="module", params=[2, 3], ids=["FMI 2", "FMI 3"])
def model(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, troll: Daemon
) -> Model:
    """The FMU of the rig, as the command line makes it."""
    return plant_of(troll, tmp_path_factory.mktemp("fmu"), request.param)


def described(model: Model) -> Bus:
    """The bus that an FMU was made of."""
    return bus_file.load(model.folder / "resources" / "bus.json")


def test_r45_another_bus(model: Model, troll: Daemon, tmp_path: Path) -> None:
    bus = described(model)
    bus.slaves[2].name, bus.slaves[2].product = "EL1008", 0x03F03052
    other = Model(generate_fmu(bus, "Other", tmp_path, model.fmi).fmu)
    for mode in (ERROR, WAIT, CONTINUE):
        with pytest.raises(Exception, match="InitializationMode"):
            other.play(bus=troll.bus, whenMissing=mode, whenFailed=mode)
    fmi = " --fmi 3" if model.fmi == 3 else ""
    (error,) = refused(other, bus=troll.bus)
    there, _, here = error.partition("EL1008")
    names(there, "slave 2", f"'{troll.bus}'", "EL1018", "0x00000002", "0x03FA3052", "0x00110000")
    names(here, "0x00000002", "0x03F03052", "0x00110000")
    assert error.endswith(f": ecatctl generate Other DIR --fmu{fmi} --bus {troll.bus}")


def test_a_longer_bus(model: Model, troll: Daemon, tmp_path: Path) -> None:
    bus = described(model)
    bus.slaves.append(Slave(8, "EL1018", 2, 0x03FA3052, 0x00110000))
    other = Model(generate_fmu(bus, "Other", tmp_path, model.fmi).fmu)
    (error,) = refused(other, bus=troll.bus)
    names(error, f"'{troll.bus}'", "slave 8", "8 slaves", "ecatctl generate Other DIR --fmu")


def refused(model: Model, **start: object) -> list[str]:
    """What an instance says that cannot start."""
    with Player(model) as player:
        for name, value in start.items():
            player.set(name, value)
        with pytest.raises(Exception, match="InitializationMode"):
            player.start()
        return player.errors()


def test_no_bus(model: Model) -> None:
    (error,) = refused(model, bus="nobody")
    names(error, "'nobody'", "systemctl start ecatd@nobody'")
    (error,) = refused(model, bus="nobody", whenMissing=WAIT, patience=0.1)
    names(error, "'nobody'", "systemctl start ecatd@nobody'", "'patience'")


def test_waits_for_a_bus_that_is_missing(model: Model, start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll", ready=False)
    with model.play(bus=daemon.bus, whenMissing=WAIT, patience=60.0) as player:
        player.step()
        assert player.get("connected")
        assert player.errors() == []
    daemon.wait_ready()


def test_goes_on_without_a_bus_until_it_is_there(
    model: Model, start_daemon: Callable[..., Daemon]
) -> None:
    bus = f"t{uuid.uuid4().hex[:10]}"
    with model.play(bus=bus, whenMissing=CONTINUE, **BEAR) as player:
        player.set("el2008.channel1Output", True)
        for _ in range(5):
            assert player.get("age") == 1e9  # never fresh before the first exchange
            player.step()
        assert not player.get("connected")
        assert not player.get("el2008.valid")
        assert player.get("el2008.alState") == NOT_AVAILABLE
        assert player.get("state") == MISSING
        (warning,) = player.warnings()
        names(warning, f"'{bus}'", "systemctl start ecatd")
        daemon = start_daemon("troll", "--bus", bus)
        daemon.bus = bus
        until(player, lambda: player.get("el2008.valid") and outputs(daemon)[0] == 1)
        assert player.get("state") == OPERATIONAL
        assert player.get("age") < 1000
        assert player.errors() == []


def restart(start_daemon: Callable[..., Daemon], before: Daemon) -> Daemon:
    again: Daemon = start_daemon("troll", "--bus", before.bus)
    again.bus = before.bus
    again.env["ECATD_BUS"] = before.bus
    return again


def is_gone(error: str, daemon: Daemon) -> bool:
    """A daemon that is killed slowly, on a busy machine, stands still first."""
    bus = f"bus '{daemon.bus}'"
    ways = (f"the daemon of {bus} has ended; start it", f"the cycle of {bus} stands still")
    return error.startswith((*ways, f"{bus} is not running"))


def test_a_bus_that_ends_is_an_error(model: Model, start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll")
    with model.play(bus=daemon.bus) as player:
        player.step()
        daemon.kill_all()
        with pytest.raises(Exception, match="DoStep"):
            player.steps(30)
        (error,) = player.errors()
        assert is_gone(error, daemon)
        assert not player.get("connected")
        assert not player.get("el2008.valid")
        with pytest.raises(Exception, match="DoStep"):
            player.step()
        names(player.errors()[-1], f"fmi{model.fmi}DoStep", "after an error")
        player.fmu.reset()
        player.set("bus", "nobody")
        with pytest.raises(Exception, match="InitializationMode"):
            player.start()


def test_goes_on_while_the_bus_is_away(model: Model, start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll")
    with model.play(bus=daemon.bus, **BEAR) as player:
        player.set("el2008.channel2Output", True)
        until(player, lambda: outputs(daemon)[1] == 1)
        daemon.kill_all()
        until(player, lambda: not player.get("connected"))
        until(player, lambda: player.get("state") == MISSING)
        assert not player.get("el2008.valid")
        assert player.get("el2008.channel2Output")  # what the model wants
        names(player.warnings()[-1], f"'{daemon.bus}'", "goes on")
        again = restart(start_daemon, daemon)
        until(player, lambda: player.get("el2008.valid") and outputs(again)[1] == 1)
        assert player.errors() == []


def test_waits_while_the_bus_is_away(model: Model, start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll")
    with model.play(bus=daemon.bus, whenFailed=WAIT, patience=60.0, lease=30.0) as player:
        player.set("el2008.channel2Output", True)
        player.step()
        daemon.kill_all()
        stepped = threading.Thread(target=player.steps, args=(0.5,))
        stepped.start()
        again = restart(start_daemon, daemon)
        stepped.join(60)
        assert not stepped.is_alive()
        until(player, lambda: player.get("connected") and outputs(again)[1] == 1)
        assert player.errors() == []
        assert any("waits" in text for text in player.warnings())


def test_patience_has_an_end(model: Model, start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll")
    with model.play(bus=daemon.bus, whenFailed=WAIT, patience=0.1) as player:
        player.step()
        daemon.kill_all()
        with pytest.raises(Exception, match="DoStep"):
            player.steps(30)
        (error,) = player.errors()
        assert is_gone(error, daemon)
        names(error, "'patience'")


def test_another_bus_that_comes_back_is_an_error(
    model: Model, start_daemon: Callable[..., Daemon]
) -> None:
    daemon = start_daemon("troll")
    with model.play(bus=daemon.bus, **BEAR) as player:
        player.step()
        daemon.kill_all()
        until(player, lambda: not player.get("connected"))
        start_daemon("line:4", "--bus", daemon.bus).bus = daemon.bus
        with pytest.raises(Exception, match="DoStep"):
            player.steps(60)
        (error,) = player.errors()
        names(error, "Gold EtherCAT GCON Drive", "ecatctl generate")
