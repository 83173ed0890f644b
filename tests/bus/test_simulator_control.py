"""`ecatsim ctl` and `ecatsim.control.Simulator`: running simulators, from other processes."""

import json
import signal
import subprocess
import sys

import pytest
from masters import ECATSIM
from test_simulator_cli import ecatsim, running

from conftest import PYTHON, names, naming, one_line_error
from ecatd.base.errors import StateError, UnreachableError, UsageError
from ecatsim.control import Simulator
from ecatsim.control.requests import REQUESTS
from ecatsim.faults import FAULTS
from ecatsim.parameters import parameters

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Sockets of this test alone."""
    folder = tmp_path / "run"
    monkeypatch.setenv("ECATSIM_RUNTIME_DIR", str(folder))
    return folder


def ctl(*arguments, status=0):
    result = ecatsim("ctl", *arguments)
    assert result.returncode == status, result.stderr
    return result.stderr if status else result.stdout


def ctl_json(*arguments, status=0):
    result = ecatsim("ctl", "--json", *arguments)
    assert result.returncode == status, result.stderr
    document = json.loads(result.stdout)
    assert document.pop("schema") == 1
    return document


def test_status_and_list():
    with running() as (_, facts):
        name = str(facts["pid"])
        assert facts["name"] == name
        first, _, head, *rows = ctl("status").splitlines()
        assert first.startswith(f"name {name}  pid {name}  rig troll  interface ecat-master")
        assert head.split()[:3] == ["position", "name", "state"]
        assert [row.split()[0] for row in rows] == list("01234567")
        assert rows[2].split()[1:3] == ["EL1018", "INIT"]
        document = ctl_json("status")
        assert document["rig"] == "troll"
        assert json.loads(ctl("status", "--json", "--name", name))["rig"] == "troll"
        assert document["slaves"][2]["state"] == "INIT"
        (listed,) = ctl_json("list")["simulators"]
        assert listed == {
            "name": name,
            "pid": facts["pid"],
            "rig": "troll",
            "slaves": 8,
            "interface": "ecat-master",
        }
        assert ctl("list").splitlines()[1].split() == [name, name, "troll", "8", "ecat-master"]


def test_values_and_registers():
    with running():
        assert ctl("get", 5, "0x6000:11") == "-26214\n"
        assert ctl("set", 5, "0x1008:00", "Tester") == ""
        assert ctl("get", 5, "0x1008") == "Tester\n"
        assert ctl("registers", 2, "0x0000", 2) == "12 00\n"  # an ET1200
        assert len(ctl("registers", 2, 0, 40).splitlines()) == 3


def test_clocks():
    with running(rig="line:3"), Simulator() as simulator:
        assert ctl("clock", 1, "--drift-ppm", 50, "--step-ns", 10**12)
        before = ctl_json("clocks")["clocks"]
        assert [clock["drift_ppm"] for clock in before] == pytest.approx([0, 50, 0])
        after = [clock.local_ns for clock in simulator.clocks()]
        first, fast, last = (
            now - then["local_ns"] for now, then in zip(after, before, strict=True)
        )
        assert fast - first == pytest.approx(first * 50e-6, abs=2)
        assert last == first
        assert after[1] - after[0] == pytest.approx(10**12, abs=10**9), "all had power at once"
        head, *rows = ctl("clocks").splitlines()
        assert head.split()[:5] == ["position", "local", "ns", "system", "ns"]
        assert [row.split()[0] for row in rows] == list("012")


def test_names(folder):
    with running("--name", "left") as (_, facts), running("--name", "right", rig="line:2"):
        assert facts["name"] == "left"
        assert [row["name"] for row in ctl_json("list")["simulators"]] == ["left", "right"]
        assert len(ctl_json("--name", "right", "status")["slaves"]) == 2
        message = ctl("status", status=2)
        assert message.count("\n") == 1
        names(one_line_error(message, "ecatsim"), "2 simulators", "left", "right")
        again = ecatsim("run", "line:1", "--name", "left")
        assert again.returncode == 7
        assert again.stderr.count("\n") == 1
        names(one_line_error(again.stderr, "ecatsim"), "'left'", "running already")


def test_nobody_is_there(folder):
    message = ctl("status", status=3)
    assert message.count("\n") == 1
    names(one_line_error(message, "ecatsim"), "no simulator", folder)
    names(one_line_error(ctl("--name", "x", "status", status=3), "ecatsim"), "no simulator 'x'")
    error = ctl_json("status", status=3)["error"]
    assert error["name"] == "unreachable"
    names(ctl("list"), "no simulator")


def test_wrong_usage_is_found_before_anything_is_asked():
    message = ctl("al-error", 0, 0, status=2)
    names(one_line_error(message, "ecatsim"), "al-error: code", "0x0000", "0x0001")
    assert "arguments are required" in ctl("al-error", 0, status=2)
    assert "'fly'" in ctl("fly", status=2)


@pytest.mark.long
def test_every_command_has_help():
    text = " ".join(ctl("--help").split())
    for command in ["list", *REQUESTS, *FAULTS]:
        assert f" {command} " in text
    for request in (*REQUESTS.values(), *FAULTS.values()):
        text = " ".join(ctl(request.kind, "--help").split())
        assert request.summary() in text
        for parameter in parameters(request):
            assert parameter.about.help in text
            assert parameter.type is bool or parameter.allowed in text


def test_stop():
    with running() as (process, _):
        ctl("stop")
        assert process.wait() == 0
        assert process.stderr.read() == ""


def test_a_command_finds_the_simulator_that_runs_it():
    """It may be root in a user namespace: its own idea of the directory would be another."""
    inner = [*ECATSIM, "ctl", "--json", "status"]
    with running("--name", "other", rig="line:3"):
        result = ecatsim("run", "line:2", "--name", "mine", "--", *inner)
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout)["name"] == "mine"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_leaves_no_socket(folder, number):
    with running() as (process, _):
        assert [path.name for path in folder.iterdir()] == [f"{process.pid}.sock"]
        process.send_signal(number)
        assert process.wait() == 0
        assert list(folder.iterdir()) == []


def test_the_next_start_cleans_up_after_sigkill(folder):
    with running("--name", "killed") as (process, _):
        process.kill()
        process.wait()
        assert [path.name for path in folder.iterdir()] == ["killed.sock"]
        assert ctl_json("list")["simulators"] == []
        assert "no simulator 'killed' is running" in ctl("--name", "killed", "status", status=3)
        with running("--name", "next", rig="line:1"):
            assert [path.name for path in folder.iterdir()] == ["next.sock"]
        with running("--name", "killed", rig="line:1"):
            assert ctl_json("status")["name"] == "killed"


def test_without_a_place_for_the_socket(monkeypatch):
    monkeypatch.setenv("ECATSIM_RUNTIME_DIR", "/proc/nowhere")
    code = "print('ran')"
    result = ecatsim("run", "line:1", "--", sys.executable, "-c", code)
    assert (result.returncode, result.stdout) == (0, "ran\n")
    names(one_line_error(result.stderr, "ecatsim"), "`ecatsim ctl`", "/proc/nowhere")
    result = ecatsim("run", "line:1", "--name", "x", "--", sys.executable, "-c", code)
    assert result.returncode == 6
    names(one_line_error(result.stderr, "ecatsim"), "control socket", "/proc/nowhere/x.sock")


def test_output_that_nobody_reads_on():
    with running(rig="line:64"):
        command = f"{PYTHON} -m ecatsim ctl status | head -n 1"
        result = subprocess.run(
            ["bash", "-o", "pipefail", "-c", command], capture_output=True, text=True, check=False
        )
        assert "Traceback" not in result.stderr
        assert "defect" not in result.stderr


def test_from_python():
    with running("--name", "bench") as (process, _):
        with Simulator() as simulator:
            assert simulator.name == "bench"
            assert simulator.status().slaves[2].name == "EL1018"
            number = simulator.faults.al_error(2, code=0x001D)
            assert simulator.status().slaves[2].state == "INIT+ERROR"
            (fault,) = simulator.faults.list()
            assert (fault.id, str(fault.fault)) == (number, "al-error slave=2 code=0x001D")
            assert (fault.struck, fault.done) == (1, True)
            assert simulator.faults.clear() == 1
            simulator.set(0, 0x6085, 0, 4711)
            assert simulator.get(0, 0x6085) == 4711
            assert simulator.registers(0, 0x0000, 2) == b"\x11\x00"
            with pytest.raises(StateError, match=naming("0x7777:00")):
                simulator.get(0, 0x7777)
            with pytest.raises(UsageError, match=naming("slave 9")):
                simulator.faults.al_error(9, code=1)
            simulator.stop()
        assert process.wait() == 0
        with pytest.raises(UnreachableError, match=naming("no simulator", "'bench'")):
            Simulator("bench")
