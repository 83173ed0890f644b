"""EtherCAT.Drives.CiA402: states, start-up lists, faults, and what happens when somebody fails."""

import ctypes
import uuid
from collections.abc import Callable

import pytest
from drive_calls import (
    AUTOMATIC,
    CONTINUE,
    ELMO,
    GENERIC,
    RIG,
    Mode,
    Play,
    Player,
    Record,
    State,
    commanded,
    generic,
    in_the_meantime,
    settings,
)

from conftest import Daemon, names, wait_for
from ecatsim.control.client import Simulator

pytest_plugins = ["drive_fixtures"]
pytestmark = [pytest.mark.bus, pytest.mark.long, pytest.mark.unprivileged]

BUSY, DONE, FAILED = 1, 2, 3  # enum ecatm_sdo_state
INTEGER16, UNSIGNED32 = 3, 7
QUICK_STOP_OPTION = 0x605A


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


def test_the_start_up_list_is_written_before_the_drive_is_enabled(
    play: Play, drives: Daemon
) -> None:
    rows = [(QUICK_STOP_OPTION, 0, INTEGER16, 6), (0x6083, 0, UNSIGNED32, 70_000)]
    with play(generic(Mode.CYCLIC_VELOCITY, mode_object=0x6060), GENERIC, rows) as player:
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
    drive = generic(Mode.CYCLIC_VELOCITY, max_dropout=0.01, restart=AUTOMATIC)
    with play(drive, GENERIC, rows) as player:
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
        player.until(lambda: player.a.start_up == FAILED)
        assert player.a.state == State.READY_TO_SWITCH_ON
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


def test_the_mode_of_a_further_axis_is_written_to_its_own_object(
    play: Play, capfd: pytest.CaptureFixture[str]
) -> None:
    drive = generic(Mode.CYCLIC_TORQUE, mode_object=0x6060 + 0x800)
    with play(drive, GENERIC) as player:
        player.set(enable=True)
        player.until(lambda: player.a.start_up == FAILED)  # the drive has one axis only
    assert "object 0x6860:00 of slave 1" in capfd.readouterr().err


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
        player.disable()
        player.enable()
        player.run(0.2)
        assert player.a.phi == pytest.approx(position, abs=0.1)
        player.disable()
    rows = list(filter(commanded, record(GENERIC)))
    assert any(int(row["control"]) == 0x02 for row in rows)
    assert max(abs(row["target_position"] - row["position"]) for row in rows) < 10_000


def test_a_quick_stop_of_one_sample_stops_a_drive_that_would_hold(
    play: Play, drives: Daemon
) -> None:
    drives.ctl("sdo-write", str(GENERIC), "0x605A", "0", "6")
    try:
        with play(generic(Mode.CYCLIC_VELOCITY), GENERIC) as player:
            player.reference = lambda time: 30.0
            player.enable()
            player.until(lambda: player.a.w > 25)
            player.set(quick_stop=True)
            player.step()
            player.set(quick_stop=False)
            player.until(lambda: player.a.state == State.SWITCH_ON_DISABLED)
            assert abs(player.a.w) < 2
            player.disable()
    finally:
        drives.ctl("sdo-write", str(GENERIC), "0x605A", "0", "2")


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
            player.disable()
            player.enable()
            player.disable()
    finally:
        drives.ctl("sdo-write", str(GENERIC), "0x605A", "0", "2")


def test_a_fault_is_reset_by_an_edge_once_its_cause_is_gone(play: Play, drives: Daemon) -> None:
    drive = settings(Mode.CYCLIC_POSITION, restart=AUTOMATIC)
    with play(drive) as player, Encoder(drives, ELMO, player) as encoder:
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
    drive = settings(Mode.CYCLIC_POSITION, max_dropout=0.01, restart=AUTOMATIC)
    with play(drive) as player:
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


def is_back(player: Player) -> None:
    """The drive is there again; it stays off, and needs an edge of `enable`."""
    player.until(lambda: player.a.state == State.READY_TO_SWITCH_ON)
    player.run(0.3)
    assert (player.a.state, player.a.enabled) == (State.READY_TO_SWITCH_ON, 0)
    player.set(enable=False)
    player.step()


def test_a_drive_stays_off_when_another_slave_comes_back(
    play: Play, drives: Daemon, capfd: pytest.CaptureFixture[str]
) -> None:
    drive = settings(Mode.CYCLIC_VELOCITY, max_dropout=0.01)
    with play(drive) as player, Simulator(str(drives.child_pid("ecatsim"))) as simulator:
        player.reference = lambda time: 20.0
        player.enable()
        player.until(lambda: player.a.w > 15)
        simulator.faults.power_off(GENERIC)
        player.until(lambda: player.a.state == State.NOT_READY_TO_SWITCH_ON)
        simulator.faults.power_on(GENERIC)
        is_back(player)
        assert abs(player.a.w) < 0.1
        names(capfd.readouterr().err, "slave 0", "stays off", "enable", "was lost")
        player.enable()
        player.until(lambda: player.a.w > 15)
        player.disable()


def test_parameters_that_differ_from_the_drive_are_told(
    play: Play, capfd: pytest.CaptureFixture[str]
) -> None:
    with play(settings(Mode.CYCLIC_VELOCITY)) as player:
        player.enable()
        player.run(0.5)
        player.disable()
    assert "0x608F" not in capfd.readouterr().err
    wrong = settings(Mode.CYCLIC_VELOCITY, encoder=131072, rated_torque=0.401, rated_current=8)
    said = ""

    def told() -> bool:
        nonlocal said
        said += capfd.readouterr().err
        return said.count("one of both is wrong") == 3

    with play(wrong) as player:
        player.until(told)
    torque, current = "0.401 N.m | 0.4 N.m | 0x6076", "8 A | 5 A | 0x6075"
    lines = [line for line in said.splitlines() if "one of both" in line]
    for line, tokens in zip(
        lines, ("encoderResolution | 131072 | 65536 | 0x608F | 0.5", torque, current), strict=True
    ):
        names(line, "slave 0", *tokens.split(" | "))
    with play(generic(Mode.CYCLIC_VELOCITY, encoder=131072), GENERIC) as player:
        player.until(
            lambda: "is 131072, but the drive of slave 1 says 10000" in capfd.readouterr().err
        )


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
        is_back(player)
        player.enable()
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
        is_back(player)
        player.enable()
        begin = player.a.phi
        player.run(0.3)
        assert player.a.phi == pytest.approx(begin, abs=0.01)
        player.disable()


def test_a_model_that_dies_leaves_the_drive_without_power(
    calls: ctypes.CDLL, drives: Daemon
) -> None:
    drive = settings(Mode.CYCLIC_VELOCITY)
    with Player(calls, drives.bus, ELMO, drive, lease=5) as player, drives.client() as client:
        player.reference = lambda time: 20.0
        player.enable()
        player.run(0.2)
        status = client.signal(ELMO, 0x6041)

        def is_disabled() -> bool:  # the model takes no more samples
            client.sample()
            return int(status.raw) & 0x4F == 0x40

        wait_for(is_disabled, drives)


def test_a_drive_homes_and_follows_its_reference_again(play: Play) -> None:
    """Method 37: where it stands is 0. A drive of a model changes its mode at standstill."""
    with play(generic(Mode.CYCLIC_POSITION, homing_method=37), GENERIC) as player:
        turn = player.time
        player.reference = lambda time: 3.0 + time - turn
        player.enable()
        player.run(0.3)
        player.reference = lambda time: 1.0
        player.run(0.5)
        player.set(home=True)
        player.until(lambda: player.a.homing == 3)
        assert not player.a.enabled, "it does not follow the reference"
        assert player.a.phi == pytest.approx(0, abs=0.05)
        player.set(home=False)
        player.until(lambda: player.a.enabled)
        player.run(0.1)
        assert player.a.phi == pytest.approx(0, abs=0.05), "a relative reference begins there"
        assert player.a.homing == 3
        player.disable()
