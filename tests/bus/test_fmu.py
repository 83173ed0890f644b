"""The plant as an FMU on the simulated rig, played with FMPy in both versions of FMI."""

import os
import signal
import statistics
import subprocess
import sys
import threading
from collections.abc import Callable
from itertools import groupby
from pathlib import Path

import pytest

pytest.importorskip("fmpy", reason="FMPy is not installed (extra 'test')")

import fmpy
import numpy as np

from conftest import Daemon, names, wait_for
from ecatd.shm.contract import Outputs, Reason
from ecatdev import sample_buses
from ecatgen.fmu import generate_fmu
from player import BEAR, STEP, Model, outputs, plant_of, until

pytestmark = pytest.mark.bus

CYCLE_TIME_US = 1000
"""The FMU makes steps of a millisecond, and so does its bus."""

DRIVE = "goldGCONDrive"
CYCLIC_VELOCITY = 9
RIGS = Path(__file__).parents[1] / "rigs"
EXAMPLE = Path(__file__).parents[2] / "examples" / "fmu" / "speed_loop.py"
ERROR, CONTINUE = 1, 3  # EtherCAT.Types.BusFailure
OPERATIONAL = 5  # EtherCAT.Types.BusState
OP = 6  # EtherCAT.Types.ALState


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(2, id="FMI 2", marks=pytest.mark.long),
        pytest.param(3, id="FMI 3"),
    ],
)
def model(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, troll: Daemon
) -> Model:
    """The FMU of the rig, as the command line makes it."""
    return plant_of(troll, tmp_path_factory.mktemp("fmu"), request.param)


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
    for _ in range(5):  # it ends if a busy machine exchanges nothing for 0.1 s
        result = subprocess.run(
            [sys.executable, str(EXAMPLE), str(tmp_path / "TrollPlant.fmu"), "--bus", troll.bus],
            capture_output=True,
            text=True,
            check=False,
        )
        if result.returncode == 0:
            break
    assert (result.returncode, result.stderr) == (0, "")
    *_, last, missed = result.stdout.splitlines()
    time, reference, measured = map(float, last.split())
    assert time == pytest.approx(2.0)
    assert measured == pytest.approx(reference, rel=0.02)
    names(missed, "bus cycles passed")


def test_outputs_of_an_incident_are_played_to_the_bus(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    """The columns of an incident are the inputs of the FMU of the same bus."""
    daemon = start_daemon("troll", config=f'[flight_recorder]\nfolder = "{tmp_path / "kept"}"\n')
    entry, column = "3/0x7000:01", "el2008.channel1Output"
    with daemon.client() as client, client.claim(entry, lease=5):
        output = client.signal(entry)
        for value in (1, 0, 1, 0):
            output.raw = value
            client.commit()
            for _ in range(50):
                client.wait()
                client.sample()
    daemon.ctl("incident", "record")
    daemon.ctl("incident", "export", "last", "-o", str(tmp_path / "it.csv"))
    daemon.ctl("generate", "TrollPlant", str(tmp_path), "--fmu")
    table = fmpy.util.read_csv(str(tmp_path / "it.csv"))
    plant = str(tmp_path / "TrollPlant.fmu")
    description = fmpy.read_model_description(plant)
    inputs = {item.name for item in description.modelVariables if item.causality == "input"}
    assert inputs <= {*table.dtype.names}

    seen: list[int] = []
    stops = threading.Event()

    def watch() -> None:
        with daemon.client() as client:
            signal = client.signal(entry)
            while not stops.is_set():
                client.wait()
                client.sample()
                if seen[-1:] != [signal.raw]:
                    seen.append(signal.raw)

    watcher = threading.Thread(target=watch)
    watcher.start()
    wait_for(lambda: seen == [0], daemon)
    fmpy.simulate_fmu(
        plant,
        input=table,
        stop_time=float(table["time"][-1]),
        output_interval=STEP,
        start_values={"bus": daemon.bus, **BEAR},
    )
    stops.set()
    watcher.join()
    commanded = [int(value) for value, _ in groupby(table[column])]
    assert commanded.count(1) == 2
    assert seen == commanded


def test_the_example_without_its_bus_or_fmu(tmp_path: Path) -> None:
    for fmi, told in ((2, "bus 'nowhere' is not running"), (3, "has FMI 3.0: make it without")):
        out = generate_fmu(sample_buses.troll(), "TrollPlant", tmp_path / str(fmi), fmi).fmu
        result = subprocess.run(
            [sys.executable, str(EXAMPLE), str(out), "--bus", "nowhere"],
            capture_output=True,
            text=True,
            check=False,
        )
        said = (result.stdout + result.stderr).splitlines()
        assert (result.returncode, len(said)) == (1, 1), said
        assert told in said[0]


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
    wait_for(lambda: outputs(troll) == [0] * 8, troll)


@pytest.mark.parametrize(("interval", "cycles"), [(0.001, 1), (0.004, 4)])
def test_steps_do_not_lose_cycles_by_rounding(
    model: Model, troll: Daemon, interval: float, cycles: int
) -> None:
    """The importer adds up times, whose rounding grows with them; steps count cycles."""
    for start in (5.0, 86_400.0):
        result = fmpy.simulate_fmu(
            str(model.path),
            start_time=start,
            stop_time=start + 0.1,
            output_interval=interval,
            start_values={"bus": troll.bus, **BEAR},
            output=["cycle", "missed"],
        )
        steps = round(0.1 / interval)
        assert len(result) == steps + 1
        assert result["cycle"][-1] - result["cycle"][0] >= steps * cycles


def test_what_was_set_is_written_and_nothing_else(model: Model, troll: Daemon) -> None:
    with model.play(bus=troll.bus, **BEAR) as player:
        for _ in range(3):
            player.step()
        with troll.client() as client:
            assert client.owners() == []  # who only reads, owns nothing
            player.set("el2008.channel1Output", True)
            player.set("el2008.channel3Output", True)
            until(player, lambda: outputs(troll) == [1, 0, 1, 0, 0, 0, 0, 0])
            (owner,) = client.owners()
            assert owner.pid == os.getpid()
            assert {entry.slave for entry in owner.outputs} == {3}
        player.fmu.terminate()
        wait_for(lambda: outputs(troll) == [0] * 8, troll)


def test_a_read_only_fmu_writes_nothing(model: Model, troll: Daemon) -> None:
    with model.play(bus=troll.bus, readOnly=True) as player, troll.client() as client:
        player.set("el2008.channel1Output", True)
        for _ in range(5):
            player.step()
        assert client.owners() == []


def test_a_slave_that_is_not_operational_can_end_the_simulation(
    model: Model, troll: Daemon
) -> None:
    with model.play(bus=troll.bus, requireOperational=True) as player:
        player.step()
        troll.ctl("state", "2", "SAFEOP", "--yes")
        with pytest.raises(Exception, match="DoStep"):
            for _ in range(10_000):
                player.step()
        names(player.errors()[0], "slave 2 (EL1018)", "OP", "requireOperational")
    troll.ctl("state", "OP")
    with model.play(bus=troll.bus) as player:
        troll.ctl("state", "2", "SAFEOP", "--yes")
        for _ in range(5):
            player.step()
    troll.ctl("state", "OP")


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
        # In a cycle whose frame is late on a busy machine, nothing is valid.
        until(reader, lambda: bool(reader.get("el2008.valid")))
        assert reader.get("connected")
        other.set("el2008.channel5Output", True)
        with pytest.raises(Exception, match="DoStep"):
            other.step()
        (error,) = other.errors()
        names(error, "belongs to", f"pid {os.getpid()}", "this program itself")
        until(writer, lambda: outputs(troll) == [0, 1, 0, 0, 0, 0, 0, 0])
        reader.step()


@pytest.mark.long
def test_a_paused_simulation_loses_its_outputs(model: Model, troll: Daemon) -> None:
    for mode in (ERROR, CONTINUE):
        with model.play(bus=troll.bus, whenFailed=mode, lease=2.0) as player:
            player.set("el2008.channel4Output", True)
            until(player, lambda: outputs(troll)[3] == 1)
            wait_for(lambda: outputs(troll)[3] == 0, troll)
            if mode == ERROR:
                with pytest.raises(Exception, match="DoStep"):
                    player.step()
                (error,) = player.errors()
                names(error, "lost its outputs")
                continue
            until(player, lambda: outputs(troll)[3] == 1)
            names(player.warnings()[0], "claimed them again")


VICTIM = """
import sys
from pathlib import Path
from player import STEP, Model, Player
with Model(Path(sys.argv[1])).play(bus=sys.argv[2], lease=2.0, whenFailed=3) as player:
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
    process.wait()
    process.stdout.close()
    wait_for(lambda: outputs(troll) == [0] * 8, troll)
    with troll.client() as client:
        info = client.output("3/0x7050:01")
        assert info.state == Outputs.SAFE
        assert info.reason is Reason.DIED
    with model.play(bus=troll.bus, **BEAR) as player:  # the next one goes on at once
        player.set("el2008.channel6Output", True)
        until(player, lambda: outputs(troll) == [0, 0, 0, 0, 0, 1, 0, 0])


DOMAINS = """[gateway]
listen = []
[[domain]]
name = "fast"
[[domain]]
name = "slow"
divider = 4
slaves = ["20-39"]
"""


def test_inputs_of_a_step_go_together(start_daemon: Callable[..., Daemon], tmp_path: Path) -> None:
    """The bus never gets a mixture of two steps; 40 slaves in two domains return what they got."""
    daemon = start_daemon(str(RIGS / "domains.py"), config=DOMAINS)
    daemon.ctl("generate", "Plant", str(tmp_path), "--fmu")
    model = Model(tmp_path / "Plant.fmu")
    slaves = list(dict.fromkeys(name.split(".")[0] for name in model.variables if "." in name))
    assert len(slaves) == 40

    def entries(slave: str, word: str) -> list[int]:
        return [model.variables[f"{slave}.{word}{n}"].valueReference for n in range(1, 33)]

    written = [reference for slave in slaves for reference in entries(slave, "output")]
    read = [entries(slave, "input") for slave in slaves]
    seen: set[int] = set()
    with model.play(**BEAR) as player, daemon.client() as client:
        sent = client.group([s for n in range(20) for s in client.signals(n) if s.index == 0x7000])
        until(player, lambda: all(player.get(f"{slave}.valid") for slave in slaves))
        for n in range(1, 200):
            player.fmu.setInteger(written, [n] * len(written))
            player.step()
            for references in read:  # slaves are on their own: each has its own moment
                assert len(set(player.fmu.getInteger(references))) == 1
            client.sample()
            (value,) = set(sent.raw)
            seen.add(value)
        until(player, lambda: player.get(f"{slaves[-1]}.input32") == 199)
        assert player.get("workingCounter") == player.get("workingCounterExpected")
        assert player.errors() == []
    assert len(seen) > 10
