"""EtherCAT.Drives.CiA402: the C calls of its block move simulated motors as they are told."""

import itertools
import math

import pytest
from drive_calls import (
    ABSOLUTE,
    AUTOMATIC,
    ELMO,
    GENERIC,
    NEEDS_EDGE,
    TURN,
    Mode,
    Play,
    Record,
    commanded,
    generic,
    in_operation,
    settings,
    turn_away,
)

pytest_plugins = ["drive_fixtures"]
pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

HANDSHAKE = 0x10


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
    # A bus cycle may fall between two evaluations: then the first one switches the drive off.
    restart = AUTOMATIC if twice else NEEDS_EDGE
    with play(make(mode, restart=restart), slave) as player:
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
        player.until(lambda: player.a.phi - before == pytest.approx(1, abs=1e-3))
        player.run(0.1)
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
        # The motor follows when friction lets it.
        player.until(lambda: abs(player.a.phi - goal) < 2e-3 and abs(player.a.w) < 1e-3)
        assert abs(player.a.command[2] - wanted) <= 1
        player.disable()
        targets = [command for _, _, enabled, _, command, *_ in player.history if enabled]
    # By the time of the model: on a busy machine the motor follows in jumps.
    steps = max(abs(after - before) for before, after in itertools.pairwise(targets))
    assert 25 < steps / TURN * 2 * math.pi / 0.001 < 40
    rows = [row for row in record(ELMO) if commanded(row) and row["mode"] == Mode.CYCLIC_POSITION]
    assert max(abs(row["w"]) for row in rows) > 25
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
    assert rows[-1]["phi"] - rows[0]["phi"] == pytest.approx(12, abs=0.05)
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
        player.until(lambda: player.a.w > 1 and player.a.tau == pytest.approx(5 * 0.07, rel=0.2))
        player.disable()
    rows = [row for row in record(ELMO) if row["target_torque"]]
    assert {row["target_torque"] for row in rows} == {175}
    assert rows[-1]["i"] == pytest.approx(0.07 / 0.08, rel=0.05)
