"""EtherCAT.Drives.CiA402: the C calls of its block, on simulated drives with motors behind them."""

import ctypes
import itertools
import math
import uuid
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from drive_calls import (
    ABSOLUTE,
    CONTINUE,
    Has,
    Mode,
    Player,
    Settings,
    State,
    build,
    records,
    settings,
)

from conftest import Daemon
from ecatsim.control.client import Simulator

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

RIG = Path(__file__).parents[1] / "rigs" / "drives.py"
ELMO, GENERIC = 0, 1
BUSY, DONE, FAILED = 1, 2, 3  # enum ecatm_sdo_state
TURN = 65536
HANDSHAKE = 0x10

Play = Callable[..., Player]
Record = Callable[[int], list[dict[str, float]]]


@pytest.fixture(scope="module")
def record_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("record") / "drives.csv"


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory, record_file: Path) -> Iterator[Daemon]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DRIVES_RECORD", str(record_file))
        daemon = Daemon(tmp_path_factory.mktemp("drives"), str(RIG)).wait_ready()
    yield daemon
    assert daemon.stop() == 0
    daemon.close()


@pytest.fixture(scope="module")
def calls(tmp_path_factory: pytest.TempPathFactory, compiler: str, drives: Daemon) -> ctypes.CDLL:
    folder = tmp_path_factory.mktemp("calls")
    drives.ctl("generate", "Plant", str(folder))
    return build(folder, compiler, folder)


@pytest.fixture(scope="module")
def play(calls: ctypes.CDLL, drives: Daemon) -> Play:
    """Starts to play a drive: `play(settings, slave, start_up)`."""
    return lambda drive, slave=ELMO, rows=(): Player(calls, drives.bus, slave, drive, rows)


@pytest.fixture
def record(record_file: Path) -> Record:
    """What the simulator has recorded of a drive since the test began."""
    start = record_file.stat().st_size if record_file.exists() else 0

    def read(slave: int) -> list[dict[str, float]]:
        return records(record_file, slave, start)

    return read


def generic(mode: Mode, **values: float) -> Settings:
    """Settings for the generic drive, which maps no current and no maximum torque."""
    entries = Has.MODE_DISPLAY | Has.POSITION | Has.VELOCITY | Has.TORQUE
    return settings(
        mode, **{"entries": entries, "encoder": 10_000, "velocity_scale": 10_000} | values
    )


def turn_away(player: Player, speed: float = 20.0) -> None:
    """Moves the motor by some revolutions in velocity mode, and lets it rest."""
    player.reference = lambda time: speed
    player.enable()
    player.run(1)
    player.disable()


def commanded(row: dict[str, float]) -> bool:
    """Whether the outputs belong to somebody: at their safe values all are 0."""
    return row["control"] != 0


def in_operation(row: dict[str, float]) -> bool:
    return int(row["status"]) & 0x6F == 0x27


def check_no_jump(rows: list[dict[str, float]], mode: Mode, turn: int) -> None:
    """Far from zero, and in each step of the simulator the target is where the motor is."""
    rows = [row for row in rows if commanded(row) and row["mode"] == mode]
    assert any(map(in_operation, rows))
    assert min(abs(row["position"]) for row in rows) > 2 * turn
    assert max(abs(row["target_position"] - row["position"]) for row in rows) < turn / 500
    assert max(abs(row["w"]) for row in rows) < 0.1
    assert max(row["phi"] for row in rows) - min(row["phi"] for row in rows) < 0.01


@pytest.mark.parametrize("mode", [Mode.CYCLIC_POSITION, Mode.PROFILE_POSITION])
@pytest.mark.parametrize("slave", [ELMO, GENERIC])
@pytest.mark.parametrize("twice", [False, True], ids=["once", "evaluated twice"])
def test_position_does_not_jump_at_the_start(
    play: Play, record: Record, slave: int, mode: Mode, twice: bool
) -> None:
    make, turn = (generic, 10_000) if slave else (settings, TURN)
    with play(make(Mode.CYCLIC_VELOCITY), slave) as player:
        turn_away(player)
    with play(make(mode), slave) as player:
        player.twice = twice
        player.reference = lambda time: -3.0  # is no step for a drive that begins there
        player.enable()
        player.run(0.2)
        player.disable()
        player.enable()
        player.run(0.2)
        player.disable()
    check_no_jump(record(slave), mode, turn)


def test_a_position_reference_moves_the_motor_by_as_much(play: Play, record: Record) -> None:
    with play(settings(Mode.CYCLIC_POSITION, gear=4)) as player:
        player.enable()
        begin = player.time
        player.reference = lambda time: 0.5 - 0.5 * math.cos(min(time - begin, 1) * math.pi)
        before = player.a.phi
        player.run(1.5)
        assert player.a.phi - before == pytest.approx(1, abs=1e-3)
        player.disable()
        rows = record(ELMO)
        assert player.a.phi == pytest.approx(rows[-1]["phi"] / 4, abs=1e-4)
    moved = [row["phi"] for row in rows if in_operation(row)]
    assert moved[-1] - moved[0] == pytest.approx(4, abs=4e-3)
    assert all(b > a - 0.01 for a, b in itertools.pairwise(moved))


def test_an_absolute_reference_is_approached_slowly(play: Play, record: Record) -> None:
    with play(settings(Mode.CYCLIC_VELOCITY)) as player:
        turn_away(player)
    drive = settings(Mode.CYCLIC_POSITION, reference=ABSOLUTE, approach_speed=30)
    with play(drive) as player:
        player.until(lambda: abs(player.a.phi) > 10)
        goal = player.a.phi - 15
        player.reference = lambda time: goal
        player.enable()
        wanted = round(goal / (2 * math.pi) * TURN)
        player.until(lambda: abs(player.a.command[2] - wanted) <= 1)
        player.run(0.3)
        assert abs(player.a.command[2] - wanted) <= 1
        assert player.a.phi == pytest.approx(goal, abs=0.03)  # friction
        player.disable()
    rows = [row for row in record(ELMO) if commanded(row) and row["mode"] == Mode.CYCLIC_POSITION]
    assert 25 < max(abs(row["w"]) for row in rows) < 40
    assert max(abs(row["target_position"] - row["position"]) for row in rows) < TURN / 4


def test_profile_position_hands_set_points_over(play: Play, record: Record) -> None:
    with play(settings(Mode.PROFILE_POSITION, gear=2)) as player:
        player.enable()
        before = player.a.phi
        for steps, goal in ((1, 3.0), (2, 2.0), (3, 6.0)):
            player.reference = lambda time, goal=goal: goal
            player.until(lambda goal=goal: abs(player.a.phi - before - goal) < 1e-3)
            words = [word & HANDSHAKE for _, _, _, word, *_ in player.history]
            rises = sum(b > a for a, b in itertools.pairwise(words))
            assert rises == steps
        player.disable()
    rows = [row for row in record(ELMO) if int(row["control"]) & 0x0F == 0x0F]
    assert rows[-1]["phi"] - rows[0]["phi"] == pytest.approx(12, abs=0.01)
    # Data change only together with the strobe.
    changes = [
        b for a, b in itertools.pairwise(rows) if a["target_position"] != b["target_position"]
    ]
    assert len(changes) == 3
    assert all(int(row["control"]) & HANDSHAKE for row in changes)


@pytest.mark.parametrize("mode", [Mode.CYCLIC_VELOCITY, Mode.PROFILE_VELOCITY])
@pytest.mark.parametrize("slave", [ELMO, GENERIC])
def test_velocity(play: Play, record: Record, slave: int, mode: Mode) -> None:
    make = generic if slave else settings
    with play(make(mode, gear=-10), slave) as player:
        player.reference = lambda time: 3.0
        player.enable()
        player.until(lambda: abs(player.a.w - 3.0) < 0.05)
        player.run(0.3)
        rows = record(slave)
        assert player.a.w == pytest.approx(3.0, rel=0.02)
        assert rows[-1]["w"] == pytest.approx(-30, rel=0.02)
        assert player.a.tau == pytest.approx(0.0433 * 10, rel=0.4)  # friction
        assert player.a.i == pytest.approx(rows[-1]["i"], abs=0.2)
        player.disable()
    assert any(row["mode"] == mode and in_operation(row) for row in rows)


@pytest.mark.parametrize("mode", [Mode.CYCLIC_TORQUE, Mode.PROFILE_TORQUE])
def test_torque(play: Play, record: Record, mode: Mode) -> None:
    with play(settings(mode, gear=5)) as player:
        player.enable()
        player.run(0.05)
        assert abs(player.a.w) < 1e-3
        player.reference = lambda time: 5 * 0.07
        player.run(0.4)
        assert player.a.tau == pytest.approx(5 * 0.07, rel=0.2)
        assert player.a.w > 1
        player.disable()
    rows = [row for row in record(ELMO) if row["target_torque"]]
    assert {row["target_torque"] for row in rows} == {175}
    assert rows[-1]["i"] == pytest.approx(0.07 / 0.08, rel=0.05)


def test_states_on_the_way_up_and_down(play: Play) -> None:
    with play(settings(Mode.CYCLIC_VELOCITY)) as player:
        player.set(valid=False)
        player.run(0.02)
        player.set(valid=True)
        player.run(0.02)
        player.enable()
        player.disable()
        states = [State(state) for _, state, *_ in player.history]
        assert [s for n, s in enumerate(states) if n == 0 or s != states[n - 1]] == [
            State.NOT_READY_TO_SWITCH_ON,
            State.SWITCH_ON_DISABLED,
            State.READY_TO_SWITCH_ON,
            State.SWITCHED_ON,
            State.OPERATION_ENABLED,
            State.SWITCHED_ON,
            State.READY_TO_SWITCH_ON,
        ]
        # Enabled is what follows the reference: from the sample after, to the last but one.
        enabled = [state for _, state, enabled, *_ in player.history if enabled]
        assert set(enabled) == {State.OPERATION_ENABLED}


INTEGER16, UNSIGNED32 = 3, 7
QUICK_STOP_OPTION = 0x605A


def test_the_start_up_list_is_written_before_the_drive_is_enabled(
    play: Play, drives: Daemon
) -> None:
    rows = [(QUICK_STOP_OPTION, 0, INTEGER16, 6), (0x6083, 0, UNSIGNED32, 70_000)]
    with play(generic(Mode.CYCLIC_VELOCITY, mode_by_sdo=1), GENERIC, rows) as player:
        player.enable()
        states = [(state, start_up) for _, state, _, _, _, _, start_up in player.history]
        assert (State.READY_TO_SWITCH_ON, BUSY) in states
        assert {start_up for state, start_up in states if state > State.READY_TO_SWITCH_ON} == {
            DONE
        }
        player.disable()
    assert drives.ctl_json("sdo-read", str(GENERIC), "0x605A", "0")["value"] == 6
    assert drives.ctl_json("sdo-read", str(GENERIC), "0x6083", "0")["value"] == 70_000
    drives.ctl("sdo-write", str(GENERIC), "0x605A", "0", "2")


def test_the_list_is_written_again_when_the_drive_comes_back(play: Play, drives: Daemon) -> None:
    rows = [(0x6083, 0, UNSIGNED32, 80_000)]
    with play(generic(Mode.CYCLIC_VELOCITY), GENERIC, rows) as player:
        player.enable()
        in_the_meantime(
            player, lambda: drives.ctl("sdo-write", str(GENERIC), "0x6083", "0", "90000")
        )
        player.set(valid=False)
        player.run(0.05)
        assert not player.a.enabled
        player.set(valid=True)
        player.until(lambda: player.a.enabled)
        player.disable()
    assert drives.ctl_json("sdo-read", str(GENERIC), "0x6083", "0")["value"] == 80_000


def test_an_object_that_is_refused_keeps_the_drive_off(
    play: Play, capfd: pytest.CaptureFixture[str]
) -> None:
    rows = [(0x6083, 0, UNSIGNED32, 80_000), (QUICK_STOP_OPTION, 0, INTEGER16, 4)]
    with play(generic(Mode.CYCLIC_VELOCITY), GENERIC, rows) as player:
        player.set(enable=True)
        player.run(0.3)
        assert player.a.state == State.READY_TO_SWITCH_ON
        assert player.a.start_up == FAILED
        player.set(enable=False)
        player.run(0.01)
        assert player.a.start_up == FAILED
        player.set(enable=True)
        player.step()
        assert player.a.start_up == BUSY  # once more
        player.until(lambda: player.a.start_up == FAILED)
    said = capfd.readouterr().err
    assert "object 0x605A:00 of slave 1" in said
    assert "0x06090030" in said


def test_a_quick_stop_is_brought_to_its_end_and_left_without_a_jump(
    play: Play, record: Record
) -> None:
    with play(generic(Mode.CYCLIC_POSITION), GENERIC) as player:
        player.enable()
        begin = player.time
        player.reference = lambda time: 60 * max(0.0, time - begin - 0.1) ** 2
        player.until(lambda: player.a.w > 50)
        player.set(quick_stop=True)
        player.until(lambda: player.a.state == State.QUICK_STOP_ACTIVE)
        player.set(quick_stop=False)  # before the motor stands still
        player.until(lambda: player.a.state == State.SWITCH_ON_DISABLED)
        assert abs(player.a.w) < 2
        position = player.a.phi
        player.reference = lambda time: 1000.0
        player.until(lambda: player.a.enabled)
        player.run(0.2)
        assert player.a.phi == pytest.approx(position, abs=0.1)
        player.disable()
    rows = list(filter(commanded, record(GENERIC)))
    assert any(int(row["control"]) == 0x02 for row in rows)
    assert max(abs(row["target_position"] - row["position"]) for row in rows) < 10_000


def test_a_quick_stop_that_holds_the_drive(play: Play, drives: Daemon) -> None:
    drives.ctl("sdo-write", str(GENERIC), "0x605A", "0", "6")
    try:
        with play(generic(Mode.CYCLIC_VELOCITY), GENERIC) as player:
            player.reference = lambda time: 30.0
            player.enable()
            player.until(lambda: player.a.w > 25)
            player.set(quick_stop=True)
            player.run(0.3)
            assert player.a.state == State.QUICK_STOP_ACTIVE
            assert not player.a.enabled
            player.set(quick_stop=False)
            player.until(lambda: player.a.enabled)
            player.disable()
    finally:
        drives.ctl("sdo-write", str(GENERIC), "0x605A", "0", "2")


def test_a_fault_is_reset_by_an_edge_once_its_cause_is_gone(play: Play, drives: Daemon) -> None:
    with play(settings(Mode.CYCLIC_POSITION)) as player, Encoder(drives, ELMO, player) as encoder:
        player.enable()
        encoder.breaks()
        player.until(lambda: player.a.state == State.FAULT)
        player.run(0.1)
        player.set(fault_reset=True)
        player.run(0.1)
        assert player.a.state == State.FAULT  # the cause is still there
        encoder.is_mended()
        player.run(0.1)
        assert player.a.state == State.FAULT  # no edge
        player.set(fault_reset=False)
        player.run(0.01)
        player.set(fault_reset=True)
        player.until(lambda: player.a.enabled)  # it was enabled all the time
        encoder.breaks()
        player.until(lambda: player.a.state == State.FAULT)
        encoder.is_mended()
        player.run(0.1)
        assert player.a.state == State.FAULT  # the edge was for the fault before
        player.set(fault_reset=False)
        player.run(0.01)
        player.set(fault_reset=True)
        player.until(lambda: player.a.enabled)
        player.disable()


def test_the_reaction_to_a_fault(play: Play) -> None:
    with play(generic(Mode.CYCLIC_POSITION), GENERIC) as player:
        player.enable()
        begin = player.time
        player.reference = lambda time: 1e4 * (time - begin)  # nobody follows that
        player.until(lambda: player.a.state == State.FAULT)
        states = {state for _, state, *_ in player.history}
        assert State.FAULT_REACTION_ACTIVE in states
        player.set(enable=False)
        player.run(0.01)
        player.set(enable=True, fault_reset=True)
        player.reference = lambda time: 0.0
        player.until(lambda: player.a.enabled)
        player.disable()


def test_short_dropouts_are_bridged_and_long_ones_switch_off(play: Play, record: Record) -> None:
    with play(settings(Mode.CYCLIC_POSITION)) as player:
        player.enable()
        player.set(valid=False)
        player.run(0.008)
        assert player.a.enabled
        player.run(0.01)
        assert not player.a.enabled
        assert player.a.command[0] == 0
        assert player.a.state == State.NOT_READY_TO_SWITCH_ON
        player.set(valid=True)
        player.reference = lambda time: 50.0
        player.until(lambda: player.a.enabled)
        player.run(0.1)
        player.disable()
    rows = [row for row in record(ELMO) if row["mode"] == Mode.CYCLIC_POSITION]
    assert max(abs(row["w"]) for row in rows) < 0.1
    assert any(row["control"] == 0 for row in rows)


def test_a_drive_that_lost_its_power_comes_back_without_a_jump(
    play: Play, drives: Daemon, record: Record
) -> None:
    rows = [(0x6083, 0, UNSIGNED32, 75_000)]
    with (
        play(generic(Mode.CYCLIC_POSITION), GENERIC, rows) as player,
        Simulator(str(drives.child_pid("ecatsim"))) as simulator,
    ):
        player.enable()
        before = player.a.phi
        player.reference = lambda time: -500.0  # would be a jump, if it counted from before
        simulator.faults.power_off(GENERIC)
        player.until(lambda: player.a.state == State.NOT_READY_TO_SWITCH_ON)
        assert (player.a.enabled, player.a.command[0]) == (0, 0)
        simulator.faults.power_on(GENERIC)
        player.until(lambda: player.a.enabled, 60)
        player.run(0.2)
        assert player.a.phi == pytest.approx(before, abs=0.1)
        player.disable()
    assert drives.ctl_json("sdo-read", str(GENERIC), "0x6083", "0")["value"] == 75_000
    assert max(abs(row["w"]) for row in record(GENERIC)[-2000:]) < 0.1


def test_a_bus_that_dies_and_comes_back(
    calls: ctypes.CDLL, start_daemon: Callable[..., Daemon]
) -> None:
    name = f"t{uuid.uuid4().hex[:10]}"
    first = start_daemon(str(RIG), "--bus", name)
    first.bus = name
    drive = settings(Mode.CYCLIC_POSITION)
    with Player(calls, name, ELMO, drive, failure=CONTINUE) as player:
        player.enable()
        player.reference = lambda time: 5.0
        player.run(0.5)
        first.kill_all()
        player.until(lambda: not player.a.enabled)
        assert player.a.state == State.NOT_READY_TO_SWITCH_ON
        player.reference = lambda time: -300.0
        in_the_meantime(player, lambda: start_daemon(str(RIG), "--bus", name))
        player.until(lambda: player.a.enabled)
        begin = player.a.phi
        player.run(0.3)
        assert player.a.phi == pytest.approx(begin, abs=0.01)
        player.disable()


def test_a_model_that_dies_leaves_the_drive_without_power(play: Play, drives: Daemon) -> None:
    player = play(settings(Mode.CYCLIC_VELOCITY))
    player.reference = lambda time: 20.0
    player.enable()
    player.run(0.2)
    with drives.client() as client:
        status = client.bind(ELMO, 0x6041)
        client.wait(1000)  # the model takes no more samples
        client.sample()
        assert int(client.read(status)) & 0x4F == 0x40
    player.__exit__()


class Encoder:
    """The cable of an encoder, in the hands of the test; the player plays on meanwhile."""

    def __init__(self, daemon: Daemon, slave: int, player: Player) -> None:
        self._daemon, self._slave, self._player = daemon, slave, player

    def __enter__(self) -> "Encoder":
        return self

    def __exit__(self, *_: object) -> None:
        self.is_mended()

    def breaks(self) -> None:
        self._write(1)

    def is_mended(self) -> None:
        self._write(0)

    def _write(self, value: int) -> None:
        in_the_meantime(
            self._player,
            lambda: self._daemon.ctl("sdo-write", str(self._slave), "0x2100", "0", str(value)),
        )


def in_the_meantime(player: Player, work: Callable[[], object]) -> None:
    """Plays on until some work is done."""
    with ThreadPoolExecutor(1) as pool:
        done = pool.submit(work)
        while not done.done():
            player.step()
        done.result()
