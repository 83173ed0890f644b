"""The plant as an FMU on the simulated rig, played with FMPy in both versions of FMI."""

import os
import signal
import statistics
import subprocess
import sys
import threading
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("fmpy", reason="FMPy is not installed (extra 'test')")

import fmpy
import numpy as np

from conftest import Daemon, wait_for
from ecatd.model import bus_file
from ecatd.model.bus import Bus, Slave
from ecatd.shm import Outputs, Reason
from ecatgen.fmu import generate_fmu
from player import STEP, Model, Player

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

DRIVE = "goldGCONDrive"
CYCLIC_VELOCITY = 9
EXAMPLE = Path(__file__).parents[2] / "examples" / "fmu" / "speed_loop.py"
ERROR, WAIT, CONTINUE = 1, 2, 3  # EtherCAT.Types.BusFailure
MISSING, OPERATIONAL = 1, 5  # EtherCAT.Types.BusState
NOT_AVAILABLE, OP = 1, 6  # EtherCAT.Types.ALState


@pytest.fixture(scope="module", params=[2, 3], ids=["FMI 2", "FMI 3"])
def model(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, troll: Daemon
) -> Model:
    """The FMU of the rig, as the command line makes it."""
    out = tmp_path_factory.mktemp("fmu")
    said = troll.ctl("generate", "TrollPlant", str(out), "--fmu", "--fmi", str(request.param))
    assert said.stdout.startswith(
        f"{out}/TrollPlant.fmu: FMI {request.param}.0, 8 slaves, 14 inputs, "
    )
    return Model(out / "TrollPlant.fmu")


def test_a_saved_scan_gives_the_same_fmu(model: Model, troll: Daemon, tmp_path: Path) -> None:
    troll.ctl("scan", "-o", str(tmp_path / "bus.json"))
    options = ("--fmu", "--fmi", str(model.fmi), "--from", str(tmp_path / "bus.json"))
    troll.ctl("generate", "TrollPlant", str(tmp_path), *options)
    assert (tmp_path / "TrollPlant.fmu").read_bytes() == model.path.read_bytes()
    again = troll.ctl("generate", "TrollPlant", str(tmp_path), *options, "--check")
    assert again.stdout == f"{tmp_path}/TrollPlant.fmu: nothing would change\n"


def control_word(status: int) -> int:
    """The next command on the way to "Operation enabled" (CiA 402)."""
    if status & 0x08:
        return 0x80  # fault reset
    if status & 0x4F == 0x40:
        return 0x06  # shutdown
    return 0x07 if status & 0x6F == 0x21 else 0x0F


def outputs(daemon: Daemon) -> list[float]:
    """What the bus sends to the eight digital outputs of slave 3."""
    with daemon.client() as client:
        client.sample()
        return [float(entry.raw) for entry in client.signals(3)]


def until(player: Player, condition: Callable[[], bool], seconds: float = 30) -> None:
    """Makes steps until something has come about."""
    for _ in range(round(seconds / STEP)):
        if condition():
            return
        player.step()
    pytest.fail(f"it does not come about; the FMU has said {player.said}")


BEAR: dict[str, Any] = {"lease": 0.5, "whenFailed": CONTINUE}
"""Parameters with which a busy machine, on which a step comes too late, does no harm."""


def test_a_closed_speed_loop(model: Model, troll: Daemon) -> None:
    """A PI controller outside the FMU makes the motor follow a ramp, then a constant speed."""
    speed, integral, n = 100_000.0, 0.0, 0
    errors: list[float] = []
    cycles: list[int] = []
    with model.play(bus=troll.bus, **BEAR) as player:
        assert player.get("connected")
        player.set(f"{DRIVE}.modeOfOperation", CYCLIC_VELOCITY)
        player.set(f"{DRIVE}.maxTorque", 1000)
        player.set(f"{DRIVE}.targetVelocity", 0)

        def enabled() -> bool:
            status = player.get(f"{DRIVE}.statusWord")
            player.set(f"{DRIVE}.controlWord", control_word(status))
            return status & 0x6F == 0x27

        until(player, enabled)
        while n < 2000 or (max(map(abs, errors[-200:])) > 0.02 * speed and n < 20_000):
            enabled()  # also after the lease was lost, on a busy machine
            reference = speed * min(n / 1000, 1.0)
            error = reference - player.get(f"{DRIVE}.velocityActualValue")
            integral += 2.0 * error * 0.001
            player.set(f"{DRIVE}.targetVelocity", round(reference + 0.2 * error + integral))
            player.step()
            errors.append(error)
            cycles.append(player.get("cycle"))
            n += 1
        until(player, lambda: player.get(f"{DRIVE}.valid") and player.get("state") == OPERATIONAL)
        assert player.get(f"{DRIVE}.alState") == OP
        assert player.get(f"{DRIVE}.modeOfOperationDisplay") == CYCLIC_VELOCITY
        assert player.get("workingCounter") == player.get("workingCounterExpected") > 0
        player.fmu.terminate()
        assert player.errors() == []
    assert cycles == sorted(cycles)
    assert cycles[-1] - cycles[0] >= n - 1  # each step has waited for a cycle
    assert statistics.median(map(abs, errors[:1000])) < 0.1 * speed
    assert max(map(abs, errors[-200:])) < 0.02 * speed


def test_the_example(troll: Daemon, tmp_path: Path) -> None:
    troll.ctl("generate", "TrollPlant", str(tmp_path), "--fmu")
    result = subprocess.run(
        [sys.executable, str(EXAMPLE), str(tmp_path / "TrollPlant.fmu"), "--bus", troll.bus],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (result.returncode, result.stderr) == (0, "")
    *_, last, missed = result.stdout.splitlines()
    time, reference, measured = map(float, last.split())
    assert time == pytest.approx(2.0)
    assert measured == pytest.approx(reference, rel=0.02)
    assert missed.endswith(" steps came too late")


def test_a_simulation_by_fmpy(model: Model, troll: Daemon) -> None:
    """As users run it: an input that changes, outputs recorded."""
    signals = np.array(
        [(0.0, False), (0.1, False), (0.1, True), (0.3, True)],
        dtype=[("time", np.float64), ("el2008.channel7Output", np.bool_)],
    )
    result = fmpy.simulate_fmu(
        str(model.path),
        stop_time=0.3,
        output_interval=STEP,
        start_values={"bus": troll.bus, **BEAR},
        input=signals,
        output=["cycle", "el2008.valid", "el2008.channel7Output"],
    )
    assert len(result) == 301
    assert all(np.diff(result["cycle"]) >= 0)
    assert result["cycle"][-1] - result["cycle"][0] >= 299
    assert any(result["el2008.valid"])
    assert result["el2008.channel7Output"][[0, 300]].tolist() == [False, True]
    assert outputs(troll) == [0] * 8


def test_what_was_set_is_written_and_nothing_else(model: Model, troll: Daemon) -> None:
    with model.play(bus=troll.bus, **BEAR) as player:
        for _ in range(3):
            player.step()
        with troll.client() as client:
            assert client.claims() == []  # who only reads, owns nothing
            player.set("el2008.channel1Output", True)
            player.set("el2008.channel3Output", True)
            until(player, lambda: outputs(troll) == [1, 0, 1, 0, 0, 0, 0, 0])
            (owner,) = client.claims()
            assert owner.pid == os.getpid()
            assert {entry.slave for entry in owner.outputs} == {3}
        player.fmu.terminate()
        wait_for(lambda: outputs(troll) == [0] * 8, troll)


def test_a_read_only_fmu_writes_nothing(model: Model, troll: Daemon) -> None:
    with model.play(bus=troll.bus, readOnly=True) as player, troll.client() as client:
        player.set("el2008.channel1Output", True)
        for _ in range(5):
            player.step()
        assert client.claims() == []


def test_physical_values(model: Model, troll: Daemon) -> None:
    """Analog inputs come in volts, as the device profile says."""
    channel = "el3008.aiStandardChannel1Value"
    assert model.variables[channel].unit == "V"
    with model.play(bus=troll.bus) as player, troll.client() as client:

        def same_cycle() -> bool:
            client.sample()
            return bool(client.domain().cycle == player.get("cycle"))

        until(player, same_cycle)
        raw = float(client.signal("4/0x6000:11").raw)
        assert player.get(channel) == pytest.approx(raw * 10 / 32767, rel=1e-3)


def test_steps_of_all_lengths_wait_for_whole_cycles(model: Model, troll: Daemon) -> None:
    """On the long run there are as many bus cycles as the steps are long, or more."""
    with model.play(bus=troll.bus) as player:
        first = player.get("cycle")
        for length in (0.0005, 0.0005, 0.0025, 0.0015, 0.01, 0.0003, 0.0047) * 5:
            player.step(length)
        assert player.get("cycle") - first >= 99


def test_without_waiting_steps_do_not_need_new_cycles(model: Model, troll: Daemon) -> None:
    with model.play(bus=troll.bus, waitForBus=False) as player:
        first = player.get("cycle")
        for _ in range(100):
            player.step(1.0)  # would take 100 s
        assert player.get("cycle") - first < 50_000


def test_many_read_and_one_writes(model: Model, troll: Daemon) -> None:
    """Instances in one process: the second one that writes is told who owns the output."""
    with (
        model.play(bus=troll.bus, **BEAR) as writer,
        model.play(bus=troll.bus) as reader,
        model.play(bus=troll.bus) as other,
    ):
        writer.set("el2008.channel2Output", True)
        until(writer, lambda: outputs(troll) == [0, 1, 0, 0, 0, 0, 0, 0])
        reader.step()
        assert reader.get("connected")
        assert reader.get("el2008.valid")
        other.set("el2008.channel5Output", True)
        with pytest.raises(Exception, match="DoStep"):
            other.step()
        (error,) = other.errors()
        assert f"belongs to python (pid {os.getpid()}); end it" in error
        until(writer, lambda: outputs(troll) == [0, 1, 0, 0, 0, 0, 0, 0])
        reader.step()


# --- another bus, no bus, a bus that comes and goes -----------------------------------------------


def described(model: Model) -> Bus:
    """The bus that an FMU was made of."""
    return bus_file.load(model.folder / "resources" / "bus.json")


def test_another_bus(model: Model, troll: Daemon, tmp_path: Path) -> None:
    bus = described(model)
    bus.slaves[2].name, bus.slaves[2].product = "EL1008", 0x03F03052
    other = Model(generate_fmu(bus, "Other", tmp_path, model.fmi).fmu)
    for mode in (ERROR, WAIT, CONTINUE):
        with pytest.raises(Exception, match="InitializationMode"):
            other.play(bus=troll.bus, whenMissing=mode, whenFailed=mode)
    fmi = " --fmi 3" if model.fmi == 3 else ""
    (error,) = refused(other, bus=troll.bus)
    assert error == (
        f"slave 2 of bus '{troll.bus}' is EL1018 (vendor 0x00000002, product 0x03FA3052, revision "
        "0x00110000), but this FMU was generated for EL1008 (vendor 0x00000002, product "
        "0x03F03052, revision 0x00110000); regenerate it with: ecatctl generate Other DIR --fmu"
        f"{fmi}"
    )


def test_a_longer_bus(model: Model, troll: Daemon, tmp_path: Path) -> None:
    bus = described(model)
    bus.slaves.append(Slave(8, "EL1018", 2, 0x03FA3052, 0x00110000))
    other = Model(generate_fmu(bus, "Other", tmp_path, model.fmi).fmu)
    (error,) = refused(other, bus=troll.bus)
    assert error.startswith(f"bus '{troll.bus}' has no slave 8 (it has 8 slaves), but this FMU was")


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
    assert error.startswith("no ecatd serves bus 'nobody'")
    (error,) = refused(model, bus="nobody", whenMissing=WAIT, patience=0.1)
    assert " s, as long as 'patience' allows" in error
    assert error.startswith("no ecatd serves bus 'nobody'")


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
            player.step()
        assert not player.get("connected")
        assert not player.get("el2008.valid")
        assert player.get("el2008.alState") == NOT_AVAILABLE
        assert player.get("state") == MISSING
        (warning,) = player.warnings()
        assert warning.startswith(f"no ecatd serves bus '{bus}'")
        daemon = start_daemon("troll", "--bus", bus)
        daemon.bus = bus
        until(player, lambda: player.get("el2008.valid") and outputs(daemon)[0] == 1)
        assert player.get("state") == OPERATIONAL
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
    return error.startswith((*ways, f"no ecatd serves {bus}"))


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
        assert player.errors()[-1].endswith("DoStep is not allowed after an error")
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
        assert player.warnings()[-1].endswith("; going on without it")
        again = restart(start_daemon, daemon)
        until(player, lambda: player.get("el2008.valid") and outputs(again)[1] == 1)
        assert player.errors() == []


def test_waits_while_the_bus_is_away(model: Model, start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll")
    with model.play(bus=daemon.bus, whenFailed=WAIT, patience=60.0, lease=0.5) as player:
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
        assert any(text.endswith("; waiting for it") for text in player.warnings())


def test_patience_has_an_end(model: Model, start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll")
    with model.play(bus=daemon.bus, whenFailed=WAIT, patience=0.1) as player:
        player.step()
        daemon.kill_all()
        with pytest.raises(Exception, match="DoStep"):
            player.steps(30)
        (error,) = player.errors()
        assert is_gone(error, daemon)
        assert " s, as long as 'patience' allows" in error


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
        assert "but this FMU was generated for Gold EtherCAT GCON Drive" in error


def test_a_paused_simulation_loses_its_outputs(model: Model, troll: Daemon) -> None:
    for mode in (ERROR, CONTINUE):
        with model.play(bus=troll.bus, whenFailed=mode) as player:
            player.set("el2008.channel4Output", True)
            player.step()
            player.step()
            wait_for(lambda: outputs(troll)[3] == 0, troll)
            if mode == ERROR:
                with pytest.raises(Exception, match="DoStep"):
                    player.step()
                (error,) = player.errors()
                assert "did not sample in time and lost its outputs" in error
                continue
            until(player, lambda: outputs(troll)[3] == 1)
            assert player.warnings()[0].endswith("; this FMU does so")


VICTIM = """
import sys
from pathlib import Path
from player import STEP, Model, Player
with Model(Path(sys.argv[1])).play(bus=sys.argv[2], lease=0.5, whenFailed=3) as player:
    player.set("el2008.channel6Output", True)
    while True:
        player.step()
        print(flush=True)
"""


def test_a_killed_fmu_leaves_safe_outputs(model: Model, troll: Daemon, tmp_path: Path) -> None:
    copy = tmp_path / "TrollPlant.fmu"
    copy.write_bytes(model.path.read_bytes())
    tests = str(Path(__file__).parents[1])
    process = subprocess.Popen(
        [sys.executable, "-c", VICTIM, str(copy), troll.bus],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([tests, *sys.path])},
        stdout=subprocess.PIPE,
    )
    assert process.stdout is not None
    for _ in range(10):
        assert process.stdout.readline() == b"\n"
    wait_for(lambda: outputs(troll) == [0, 0, 0, 0, 0, 1, 0, 0], troll)
    process.send_signal(signal.SIGKILL)
    process.wait(10)
    process.stdout.close()
    wait_for(lambda: outputs(troll) == [0] * 8, troll)
    with troll.client() as client:
        info = client.output("3/0x7050:01")
        assert info.state == Outputs.SAFE
        assert info.reason in (Reason.LAPSED, Reason.GONE)
    with model.play(bus=troll.bus, **BEAR) as player:  # the next one goes on at once
        player.set("el2008.channel6Output", True)
        until(player, lambda: outputs(troll) == [0, 0, 0, 0, 0, 1, 0, 0])
