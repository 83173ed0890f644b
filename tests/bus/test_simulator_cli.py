"""The command `ecatsim`: what it says, how it ends, and what it leaves behind: nothing."""

import contextlib
import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from masters import ECATSIM

from conftest import names, one_line_error

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

SCAN = (
    "import pysoem; m = pysoem.Master(); m.open('ecat-master'); print(m.config_init()); m.close()"
)
FORBID = """
import ctypes, os, sys
libc = ctypes.CDLL(None, use_errno=True)
uid, gid = os.geteuid(), os.getegid()
assert libc.unshare(0x10000000) == 0, ctypes.get_errno()
open("/proc/self/setgroups", "w").write("deny")
open("/proc/self/uid_map", "w").write(f"0 {uid} 1")
open("/proc/self/gid_map", "w").write(f"0 {gid} 1")
open("/proc/sys/user/max_user_namespaces", "w").write("0")
for capability in range(64):
    libc.prctl(24, capability, 0, 0, 0)
os.execv(sys.executable, [sys.executable, "-m", "ecatsim", *sys.argv[1:]])
"""
JOIN = """
import sys
from ecatd.base.network_namespace import join
join(int(sys.argv[1]))
import pysoem
m = pysoem.Master()
m.open(sys.argv[2])
print(m.config_init())
"""


def ecatsim(*arguments, command=ECATSIM):
    return subprocess.run(
        [*command, *map(str, arguments)], capture_output=True, text=True, check=False
    )


@contextlib.contextmanager
def running(*arguments, rig="troll"):
    """A simulator that is ready, and what it says of itself."""
    reader, writer = os.pipe()
    process = subprocess.Popen(
        [*ECATSIM, "run", rig, "--ready-fd", str(writer), *map(str, arguments)],
        pass_fds=[writer],
        stderr=subprocess.PIPE,
        text=True,
    )
    os.close(writer)
    try:
        with os.fdopen(reader) as ready:
            line = ready.readline()
        assert line, process.stderr.read()
        yield process, json.loads(line)
    finally:
        process.kill()
        process.wait()
        process.stderr.close()


def ends(pid):
    """Whether a process that is not our child ends soon."""
    for _ in range(500):
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        except (FileNotFoundError, ProcessLookupError):
            return True
        if state == "Z":
            return True
        time.sleep(0.01)
    return False


def child_of(pid):
    """The command that a simulator runs."""
    for _ in range(500):
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        if children:
            return int(children[0])
        time.sleep(0.01)
    raise AssertionError("no command was started")


def test_command_runs_beside_the_segment():
    result = ecatsim("run", "troll", "--", sys.executable, "-c", SCAN)
    assert (result.returncode, result.stdout) == (0, "8\n"), result.stderr


@pytest.mark.parametrize(
    ("code", "status"),
    [("raise SystemExit(7)", 7), ("import os; os.kill(os.getpid(), 9)", 128 + 9), ("", 0)],
)
def test_exit_status_is_that_of_the_command(code, status):
    assert ecatsim("run", "line:1", "--", sys.executable, "-c", code).returncode == status


def test_help_version_and_rigs():
    assert ecatsim("--version").stdout.startswith("ecatsim ")
    assert "--ready-fd" in ecatsim("run", "--help").stdout
    listed = ecatsim("rigs")
    assert listed.returncode == 0
    assert [line.split()[0] for line in listed.stdout.splitlines()] == [
        "troll",
        "troll-can",
        "two-axes",
        "line:N",
        "terminals:N",
        "branches",
        "empty",
    ]


def test_check_lists_what_is_in_a_rig(tmp_path):
    file = tmp_path / "small.toml"
    file.write_text('[[slave]]\ndevice = "EK1100"\n[[slave]]\ndevice = "EL2008"\nalias = 7\n')
    result = ecatsim("check", file)
    assert (result.returncode, result.stderr) == (0, "")
    first, _, *rows = result.stdout.splitlines()
    assert first == "rig small: 2 slaves"
    assert [row.split() for row in rows] == [
        ["0", "00000002:044c2c52:00120000", "0", "0", "EK1100"],
        ["1", "00000002:07d83052:00100000", "1", "0", "0:1", "EL2008", "(alias", "7)"],
    ]
    facts = json.loads(ecatsim("check", "--json", file).stdout)
    assert (facts["schema"], facts["rig"], facts["ring"]) == (1, "small", None)
    assert facts["slaves"][1] == {
        "position": 1,
        "name": "EL2008",
        "vendor": 2,
        "product": 0x07D83052,
        "revision": 0x00100000,
        "alias": 7,
        "output_bytes": 1,
        "input_bytes": 0,
        "parent": 0,
        "port": 1,
    }


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (["check", "missing.toml"], 2, "missing.toml | No such file"),
        (
            ["run", "nonsense"],
            2,
            "no rig | 'nonsense' | ecatsim rigs",
        ),
        (["run", "line:9999"], 2, "line:9999 | 1 | 1024"),
        (["run", "missing.py"], 2, "no rig file | 'missing.py'"),
        (["run", "troll", "--interface", "nope0"], 3, "network interface | 'nope0'"),
        (["run", "line:1", "--trace", "x.csv"], 2, "line:1 | trace"),
        (["run", "troll", "--trace", "/nowhere/x"], 2, "'/nowhere/x' | No such file"),
        (["run", "line:1", "--", "no-such-command"], 2, "'no-such-command'"),
        (["run", "line:1", "stray"], 2, "`--` | command"),
        (["run", "line:1", "--ready-fd", "99"], 2, "--ready-fd 99 | Bad file descriptor"),
        (["run", "line:1", "--ready-fd", "-1"], 2, "--ready-fd -1 | file descriptor"),
        (["run", "line:1", "--step-time-us", "999"], 2, "--step-time-us 999 | 1000 | 10000"),
        (["run", "line:1", "--step-time-us", "10001"], 2, "10001 | 1000 | 10000"),
        (["run"], 2, "required | RIG"),
        ([], 2, "required | COMMAND"),
    ],
)
def test_errors_are_one_line(arguments, status, message):
    result = ecatsim(*arguments)
    assert result.returncode == status, result.stderr
    names(one_line_error(result.stderr, "ecatsim"), *message.split(" | "))
    assert len(result.stderr.splitlines()) == 1


_FAILING = """
from ecatsim import DataType, Device, Entry, Pdo, Rig

class Failing(Device):
    vendor, product, revision, order = 1, 1, 1, "Failing"
    tx_pdos = (Pdo(0x1A00, "", 3, [Entry(0x6000, 1, "x", DataType.INTEGER32, 32)]),)

    def step(self, now):
        STATEMENT

def rig():
    return Rig("failing", [Failing()])
"""


@pytest.mark.parametrize(
    ("statement", "status", "message"),
    [
        ("1 / 0", 70, "ZeroDivisionError"),
        ("self[0x6001, 1] = 1", 2, "0x6001:01"),
    ],
)
def test_a_device_that_fails_is_named_with_file_and_line(tmp_path, statement, status, message):
    file = tmp_path / "failing.py"
    file.write_text(_FAILING.replace("STATEMENT", statement))
    result = ecatsim("run", file, "--", "sleep", "5")
    assert (result.returncode, result.stderr.count("\n")) == (status, 1)
    names(one_line_error(result.stderr, "ecatsim"), f"{file}:9: ", message)


def test_interface_that_is_down():
    inner = [*ECATSIM, "run", "line:1", "--interface", "lo"]
    result = ecatsim("run", "empty", "--", *inner)
    assert result.returncode == 7
    assert result.stderr.count("\n") == 1
    names(one_line_error(result.stderr, "ecatsim"), "'lo'", "down", "`ip link set lo up`")


def test_existing_interface():
    """A second simulator serves the veth end of the first, whose own segment is empty."""
    code = (
        "import os, subprocess, sys; r, w = os.pipe(); "
        "from ecatsim.net.netlink import create_veth; create_veth('my-sim', 'my-master'); "
        "p = subprocess.Popen([sys.executable, '-m', 'ecatsim', 'run', 'line:5', '--interface', "
        "'my-sim', '--ready-fd', str(w)], pass_fds=[w]); print(os.read(r, 999).decode()); "
        "import pysoem; m = pysoem.Master(); m.open('my-master'); print(m.config_init()); "
        "p.terminate(); sys.exit(p.wait())"
    )
    result = ecatsim("run", "empty", "--", sys.executable, "-c", code)
    assert result.returncode == 0, result.stderr
    facts, _, count = result.stdout.splitlines()
    assert json.loads(facts)["interface"] == "my-sim"
    assert count == "5"


def test_user_namespaces_forbidden():
    result = ecatsim("run", "troll", command=[sys.executable, "-c", FORBID])
    assert result.returncode == 6, result.stderr
    names(one_line_error(result.stderr, "ecatsim"), "user namespaces")
    for remedy in ("run as root", "user.max_user_namespaces", "apparmor_restrict"):
        assert remedy in result.stderr
    assert len(result.stderr.splitlines()) == 1


def test_raw_socket_forbidden():
    result = ecatsim("run", "troll", "--interface", "lo", command=[sys.executable, "-c", FORBID])
    assert result.returncode == 6, result.stderr
    names(one_line_error(result.stderr, "ecatsim"), "'lo'", "CAP_NET_RAW", "root")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_ends_it_and_nothing_is_left(number):
    with running() as (process, facts):
        path = Path(f"/proc/{facts['pid']}/ns/net")
        # Held open, for otherwise the kernel may give its number to the next namespace.
        held = path.open("rb")
        namespace = path.readlink()
        process.send_signal(number)
        assert process.wait() == 0
        assert process.stderr.read() == ""
    left = []
    with held:
        for path in Path("/proc").glob("[0-9]*/ns/net"):
            with contextlib.suppress(OSError):
                left.append(path.readlink())
    assert namespace not in left
    assert "ecat-" not in Path("/proc/net/dev").read_text()


def test_signal_ends_the_command_too():
    with running("--", sys.executable, "-c", "import time; time.sleep(60)", rig="line:1") as (
        process,
        facts,
    ):
        child = child_of(facts["pid"])
        process.send_signal(signal.SIGTERM)
        assert process.wait() == 128 + signal.SIGTERM
        assert ends(child)


def test_command_dies_with_a_killed_simulator():
    with running("--", sys.executable, "-c", "import time; time.sleep(60)", rig="line:1") as (
        process,
        facts,
    ):
        child = child_of(facts["pid"])
        process.kill()
        process.wait()
        assert ends(child)


def test_it_dies_with_its_parent():
    code = (
        "import os, subprocess, sys; r, w = os.pipe(); "
        "subprocess.Popen([sys.executable, '-m', 'ecatsim', 'run', 'line:1', '--die-with-parent', "
        "'--ready-fd', str(w)], pass_fds=[w]); print(os.read(r, 999).decode(), flush=True); "
        "os.kill(os.getpid(), 9)"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert ends(json.loads(result.stdout)["pid"])


def test_join_from_another_process():
    with running() as (_, facts):
        assert (facts["rig"], facts["slaves"]) == ("troll", 8)
        result = subprocess.run(
            [sys.executable, "-c", JOIN, str(facts["pid"]), facts["interface"]],
            capture_output=True,
            text=True,
            check=False,
        )
        assert (result.returncode, result.stdout) == (0, "8\n"), result.stderr


def test_join_without_a_simulator():
    code = "from ecatd.base.network_namespace import join; join(2**22 + 1)"
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    names(result.stderr, "ecatd.base.errors.UnreachableError", "simulator", 4194305)


def test_trace_records_the_motor(tmp_path):
    file = tmp_path / "trace.csv"
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]); import test_simulator_masters as t; "
        "t.master_exchange()"
    )
    command = [sys.executable, "-c", code, Path(__file__).parent]
    result = ecatsim("run", "troll", "--trace", file, "--", *command)
    assert result.returncode == 0, result.stderr
    with file.open() as lines:
        rows = list(csv.DictReader(lines))
    times = [int(row["time_ns"]) for row in rows]
    assert times == sorted(times)
    assert len(rows) > 100
    speeds = [float(row["velocity_counts_per_s"]) for row in rows]
    assert 190_000 < max(speeds) < 260_000
    assert max(float(row["reference_counts_per_s"]) for row in rows) == 200_000
    assert max(float(row["current_A"]) for row in rows) > 0.5


def test_steps_are_as_far_apart_as_asked_for(tmp_path):
    file = tmp_path / "trace.csv"
    options = ("--trace", file, "--step-time-us", "10000")
    result = ecatsim("run", "troll", *options, "--", "sleep", "0.5")
    assert result.returncode == 0, result.stderr
    with file.open() as lines:
        times = [int(row["time_ns"]) for row in csv.DictReader(lines)]
    # A late step is followed by one in time, so that only all together say how far apart they are.
    assert len(times) > 1
    assert times[-1] - times[0] > (len(times) - 2) * 7_500_000


def test_example_of_the_documentation(tmp_path):
    text = (Path(__file__).parents[2] / "docs" / "simulator-rigs.md").read_text()
    file = tmp_path / "doublers.py"
    file.write_text(text.split("```python\n")[1].split("```")[0])
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]); import test_simulator_masters as t; "
        "m = t.open_pysoem(); t.to_op(m); m.slaves[1].output = b'\\x15\\x00'; t.cycle(m, 50); "
        "print(m.slaves[1].name, m.slaves[1].input[0])"
    )
    command = [sys.executable, "-c", code, Path(__file__).parent]
    result = ecatsim("run", file, "--", *command)
    assert (result.returncode, result.stdout) == (0, "Doubler 42\n"), result.stderr
