"""What an importer may do wrong: calls have a status, the FMU tells why, and nothing crashes."""

import ctypes
import math
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("fmpy", reason="FMPy is not installed (extra 'test')")

from fmpy import fmi2, fmi3

from conftest import Daemon, names, wait_for
from player import DISCARD, ERROR, OK, Model, Player, plant_of

pytestmark = pytest.mark.bus

NUMBER = "goldGCONDrive.controlWord"
BOOLEAN = "el2008.channel1Output"
OUTPUT = "goldGCONDrive.statusWord"


@pytest.fixture(scope="module", params=[2, 3], ids=["FMI 2", "FMI 3"])
def model(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, troll: Daemon
) -> Model:
    """The FMU of the rig."""
    return plant_of(troll, tmp_path_factory.mktemp("fmu"), request.param)


@pytest.fixture
def player(model: Model) -> Iterator[Player]:
    """An instance that is initialized, and makes steps whenever it likes."""
    with model.play(waitForBus=False) as made:
        made.step()
        yield made


class Raw:
    """The functions of an FMU without FMPy's checks, which give their status."""

    def __init__(self, player: Player) -> None:
        self.player = player
        self.fmi = player.model.fmi
        self.component = player.fmu.component

    def __call__(self, name: str, *arguments: object) -> int:
        function = self.player.fmu.dll[f"fmi{self.fmi}{name}"]  # another object than FMPy's
        return int(function(ctypes.c_void_p(self.component), *arguments))

    def list(self, verb: str, kind: str, references: list[int], values: Any) -> int:
        """Calls a getter or setter; values: a list of ctypes, or None."""
        count = len(references)
        numbers = (ctypes.c_uint32 * count)(*references)
        rest = (ctypes.c_size_t(count),) if self.fmi == 3 else ()
        return self(f"{verb}{kind}", numbers, ctypes.c_size_t(count), values, *rest)

    def step(self, time: float, length: float) -> int:
        rest: tuple[object, ...] = (ctypes.c_int(1),)
        if self.fmi == 3:
            flags = (ctypes.c_bool * 3)()
            reached = ctypes.c_double()
            rest = (
                ctypes.c_bool(True),
                *(ctypes.byref(flags, n) for n in range(3)),
                ctypes.byref(reached),
            )
        return self("DoStep", ctypes.c_double(time), ctypes.c_double(length), *rest)


def real(model: Model) -> str:
    return "Real" if model.fmi == 2 else "Float64"


def reference(model: Model, name: str) -> int:
    return int(model.variables[name].valueReference)


@pytest.mark.parametrize("number", [100_000, 0xFFFF_FFFF])
@pytest.mark.parametrize("verb", ["Get", "Set"])
def test_a_value_reference_that_does_not_exist(player: Player, verb: str, number: int) -> None:
    values = (ctypes.c_double * 1)()
    assert Raw(player).list(verb, real(player.model), [number], values) == ERROR
    names(player.errors()[-1], f"{verb.lower()}: ", f"value reference {number}")


@pytest.mark.parametrize("verb", ["Get", "Set"])
def test_a_value_of_another_type(player: Player, verb: str) -> None:
    at = reference(player.model, BOOLEAN)
    values = (ctypes.c_double * 1)()
    assert Raw(player).list(verb, real(player.model), [at], values) == ERROR
    names(player.errors()[-1], f"'{BOOLEAN}'", f"value reference {at}", "type")


def test_outputs_cannot_be_set(player: Player) -> None:
    with pytest.raises(Exception, match="Set"):
        player.set(OUTPUT, 1)
    names(player.errors()[-1], "set: ", f"'{OUTPUT}'", "input", "parameter")


def test_parameters_are_fixed(player: Player) -> None:
    with pytest.raises(Exception, match="SetString"):
        player.set("bus", "other")
    names(player.errors()[-1], "'bus'", "fixed")


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf, -1.0])
def test_parameters_that_are_no_times(model: Model, number: float) -> None:
    with Player(model) as player:
        before = player.get("lease")
        with pytest.raises(Exception, match="Set"):
            player.set("lease", number)
        assert player.said[-1][0] == DISCARD
        assert player.get("lease") == before


@pytest.mark.parametrize("number", [0, 4, -1])
def test_parameters_that_are_no_modes(model: Model, number: int) -> None:
    with Player(model) as player:
        with pytest.raises(Exception, match="Set"):
            player.set("whenFailed", number)
        names(player.errors()[-1], "'whenFailed'", number, 1, "Error", 2, "Wait", 3, "Continue")


def test_integers_out_of_range_keep_their_value(player: Player) -> None:
    """In FMI 3.0 the type of the variable leaves no such values."""
    player.set(NUMBER, 6)
    if player.model.fmi == 2:
        for number in (70_000, -1):
            with pytest.raises(Exception, match="fmi2SetInteger"):
                player.set(NUMBER, number)
            assert player.said[-1][0] == DISCARD
            names(player.said[-1][1], "set: ", f"'{NUMBER}'", number, 0, 65535)
    assert player.get(NUMBER) == 6
    player.step()


def test_calls_in_the_wrong_state(model: Model) -> None:
    with Player(model) as player:
        raw = Raw(player)
        assert raw.step(0.0, 0.001) == ERROR
        names(player.errors()[-1], f"fmi{model.fmi}DoStep", "before")
        assert raw("ExitInitializationMode") == ERROR
        player.start()
        assert raw("ExitInitializationMode") == ERROR
        names(player.errors()[-1], f"fmi{model.fmi}ExitInitializationMode", "between steps")
        player.fmu.terminate()
        assert raw.step(0.0, 0.001) == ERROR
        names(player.errors()[-1], f"fmi{model.fmi}DoStep", "after the end")
        assert isinstance(player.get(OUTPUT), int)
        player.fmu.reset()
        player.start()
        player.step()


@pytest.mark.parametrize("length", [0.0, -1.0, math.nan, math.inf])
def test_steps_that_are_none(player: Player, length: float) -> None:
    assert Raw(player).step(0.001, length) == ERROR
    names(player.errors()[-1], "communication step")
    player.step()


def test_null_pointers(player: Player) -> None:
    raw, model = Raw(player), player.model
    at = reference(model, BOOLEAN)
    for verb in ("Get", "Set"):
        assert raw.list(verb, "Boolean", [at], None) == ERROR
        names(player.errors()[-1], f"fmi{model.fmi}{verb}Boolean: ", "null pointer")
        assert raw.list(verb, "Boolean", [], None) == OK
    raw.component = None
    assert raw.list("Get", "Boolean", [at], (ctypes.c_int * 1)()) == ERROR
    assert raw.step(0.0, 0.001) == ERROR
    assert raw("Reset") == ERROR
    player.fmu.dll[f"fmi{model.fmi}FreeInstance"](None)


def test_what_is_not_supported_says_so(player: Player) -> None:
    raw = Raw(player)
    pointer = ctypes.c_void_p()
    name = "GetFMUstate" if raw.fmi == 2 else "GetFMUState"
    assert raw(name, ctypes.byref(pointer)) == ERROR
    names(player.errors()[-1], f"fmi{raw.fmi}{name}", "not supported")
    player.step()


def test_log_categories(player: Player) -> None:
    player.fmu.setDebugLogging(True, ["logEvents", "logStatusError"])
    with pytest.raises(Exception, match="SetDebugLogging"):
        player.fmu.setDebugLogging(True, ["logWeather"])
    names(player.errors()[-1], "'logWeather'", "log category")
    before = len(player.said)
    player.fmu.setDebugLogging(False, [])
    player.fmu.terminate()
    assert len(player.said) == before


@pytest.mark.parametrize("until", ["instantiated", "initializing", "stepping", "terminated"])
def test_it_may_be_freed_at_any_time(model: Model, until: str, troll: Daemon) -> None:
    for _ in range(3):
        with Player(model) as player:
            if until == "instantiated":
                continue
            if model.fmi == 2:
                player.fmu.setupExperiment(startTime=0.0)
            player.fmu.enterInitializationMode()
            if until == "initializing":
                assert isinstance(player.get(OUTPUT), int)
                continue
            player.fmu.exitInitializationMode()
            player.set(BOOLEAN, True)
            player.step()
            if until == "terminated":
                player.fmu.terminate()
    with troll.client() as client:  # the engine sees at the end of a cycle that a slot is left
        wait_for(lambda: client.owners() == [], troll)


def test_parameters_may_change_in_the_initialization(model: Model, troll: Daemon) -> None:
    """Outputs have values then already; another bus is another connection."""
    with Player(model) as player:
        if model.fmi == 2:
            player.fmu.setupExperiment(startTime=0.0)
        player.fmu.enterInitializationMode()
        assert player.get("connected")
        player.set("bus", "nobody")
        player.set("whenMissing", 3)
        assert not player.get("connected")
        player.set("bus", troll.bus)
        assert player.get("connected")
        player.fmu.exitInitializationMode()
        player.step()


def test_many_instances(model: Model) -> None:
    players = [model.play(waitForBus=False) for _ in range(20)]
    for player in players:
        player.step()
        assert player.get("connected")
    for player in players[::2] + players[1::2]:
        player.free()


def mistake_in_token(model: Model, _folder: Path) -> tuple[str, Path | None]:
    return "{0}", None


def resources_without_table(model: Model, folder: Path) -> tuple[str, Path | None]:
    shutil.copytree(model.folder, folder / "x")
    (folder / "x" / "resources" / "plant.txt").unlink()
    return model.token, folder / "x"


def damaged_table(model: Model, folder: Path) -> tuple[str, Path | None]:
    shutil.copytree(model.folder, folder / "x")
    table = folder / "x" / "resources" / "plant.txt"
    table.write_bytes(table.read_bytes()[:-300])
    return model.token, folder / "x"


@pytest.mark.parametrize("mistake", [mistake_in_token, resources_without_table, damaged_table])
def test_what_cannot_be_instantiated(
    model: Model, mistake: Callable[[Model, Path], tuple[str, Path | None]], tmp_path: Path
) -> None:
    """An FMU whose files are not those that belong together."""
    token, folder = mistake(model, tmp_path)
    with pytest.raises(Exception, match="Failed to instantiate"):
        Player(model, token, folder)


def test_a_folder_with_strange_characters(model: Model, tmp_path: Path) -> None:
    """FMI 2.0 gives a URI, in which they are written otherwise."""
    folder = tmp_path / "größe 100% #1"
    shutil.copytree(model.folder, folder)
    with Player(model, folder=folder) as player:
        player.start()
        player.step()


def test_other_interfaces(model: Model) -> None:
    """Only co-simulation is supported; FMPy would not ask."""
    with Player(model) as player:
        dll = player.fmu.dll
        if model.fmi == 3:
            function = dll["fmi3InstantiateModelExchange"]
            arguments = (b"x", model.token.encode(), b"", False, False, None, None)
        else:
            function = dll["fmi2Instantiate"]
            callbacks = fmi2.fmi2CallbackFunctions()
            arguments = (b"x", 0, model.token.encode(), b"", ctypes.byref(callbacks), 0, 0)
        function.restype = ctypes.c_void_p
        assert function(*arguments) is None
        assert fmi3.fmi3Error == fmi2.fmi2Error == ERROR
