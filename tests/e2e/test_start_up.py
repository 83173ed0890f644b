"""Starts that fail: each says in one line what, where, why and what to do, and leaves nothing."""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from conftest import (
    CYCLE_TIME_US,
    SHM,
    Daemon,
    children,
    names,
    one_line_error,
    run_module,
    wait_for,
)
from ecatd.base.failure_record import FailureRecord, write_record
from ecatd.client.remote import Remote
from ecatd.etg.al import AlState
from ecatd.operations.bus import ReadStates
from ecatd.shm.contract import WkcState
from ecatsim.control import Simulator

RIGS = Path(__file__).parents[1] / "rigs"

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged, pytest.mark.long]


@pytest.fixture
def env(tmp_path: Path) -> dict[str, str]:
    return {**os.environ, "ECATD_RUNTIME_DIR": str(tmp_path / "run")}


def refused(
    status: int,
    *arguments: str,
    env: dict[str, str],
    wrapper: tuple[str, ...] = (),
    program: str = "ecatd",
) -> str:
    """The one line of an `ecatd` (or of its simulator) that does not start."""
    bus = arguments[arguments.index("--bus") + 1] if "--bus" in arguments else "ecat0"
    before = set(SHM.glob(f"{bus}*"))
    result = subprocess.run(
        [*wrapper, sys.executable, "-m", "ecatd.service", *arguments],
        env=env,
        text=True,
        capture_output=True,
        check=False,
    )
    assert result.returncode == status, result.stderr
    assert set(SHM.glob(f"{bus}*")) - before == set()
    return one_line_error(result.stderr, program)


def test_r10_no_such_interface(env: dict[str, str]) -> None:
    text = refused(3, "--interface", "eth77", env=env)
    names(text, "interface", "'eth77'", "lo")


def test_no_room_for_shared_memory(env: dict[str, str]) -> None:
    script = 'mount -t tmpfs -o size=16k none /dev/shm; exec "$@"'
    wrapper = ("unshare", "--user", "--map-root-user", "--mount", "sh", "-ec", script, "sh")
    text = refused(7, "--simulate", "line:1", env=env, wrapper=wrapper)
    names(text, "/dev/shm", "full", "KiB")


def test_r43_interface_without_permission(env: dict[str, str]) -> None:
    # In a user namespace of its own, this process has no rights over the system's interfaces.
    text = refused(
        6, "--interface", "lo", env=env, wrapper=("unshare", "--user", "--map-user=1000")
    )
    names(text, "CAP_NET_RAW", "ecatd --simulate troll")


def test_user_namespaces_forbidden(env: dict[str, str], tmp_path: Path) -> None:
    # Within a user namespace the number of further ones can be set to 0; what then has no right
    # to make a network namespace either is in the same position as a user of a locked-down system.
    script = tmp_path / "locked.sh"
    script.write_text(
        "echo 0 > /proc/sys/user/max_user_namespaces && "
        'exec setpriv --bounding-set -all --inh-caps -all --ambient-caps -all "$@"\n'
    )
    text = refused(
        6,
        *("--simulate", "troll"),
        env=env,
        wrapper=("unshare", "--user", "--map-root-user", "sh", str(script)),
        program="ecatsim",
    )
    assert "namespace" in text
    assert "root" in text
    assert "sysctl" in text


def test_r10_no_slaves_on_the_bus(env: dict[str, str]) -> None:
    text = refused(3, "--simulate", "empty", "--bus", "tempty", env=env)
    names(text, "no EtherCAT slave", "'ecat-master'")


LATE_LINK = """
import os, socket, subprocess, sys, time
sys.path.insert(0, sys.argv[1])
from inside import is_on, switch

switch("ecat-sim", "down")
switch("ecat-master", "down")
notify = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
notify.bind(os.environ["NOTIFY_SOCKET"])
command = [sys.executable, "-m", "ecatd.service", "--interface", "ecat-master", "--bus", "tlate"]
daemon = subprocess.Popen(command)
notify.settimeout(0.1)
told = b""
while not is_on("ecat-master"):
    assert daemon.poll() is None
time.sleep(1)  # a real port needs one to three seconds
if sys.argv[2] == "cable":
    switch("ecat-sim", "up")
while b"READY=1" not in told and daemon.poll() is None:
    try:
        told += notify.recv(4096)
    except TimeoutError:
        pass
print("ready" if b"READY=1" in told else "ended")
daemon.terminate()
sys.exit(daemon.wait())
"""


@pytest.mark.parametrize(
    ("plugged", "outcome", "status"), [("cable", "ready", 0), ("", "ended", 3)]
)
def test_r10_a_start_waits_for_the_carrier(
    plugged: str, outcome: str, status: int, tmp_path: Path
) -> None:
    """A port that was off has no carrier until both ends have agreed on a speed."""
    result = run_module(
        "ecatsim",
        *("run", "troll", "--", sys.executable, "-c", LATE_LINK),
        *(str(RIGS.parent / "bus"), plugged),
        env={
            **os.environ,
            "ECATD_RUNTIME_DIR": str(tmp_path / "run"),
            "NOTIFY_SOCKET": str(tmp_path / "notify"),
        },
    )
    assert (result.stdout, result.returncode) == (f"{outcome}\n", status), result.stderr
    assert ("'ecat-master' had no carrier" in result.stderr) == (not plugged)


def test_a_folder_whose_path_is_too_long_for_a_socket(tmp_path: Path) -> None:
    env = {**os.environ, "ECATD_RUNTIME_DIR": str(tmp_path / ("x" * 100))}
    told = run_module("ecatd.service", "--simulate", "line:1", env=env)
    assert told.returncode == 2
    names(one_line_error(told.stderr, "ecatd"), "107", "ECATD_RUNTIME_DIR")


def test_the_interface_is_left_as_it_was(tmp_path: Path) -> None:
    """SOEM makes it promiscuous; that and the link go back with the daemon."""
    code = (
        "import subprocess, sys, socket, struct, fcntl\n"
        "def flags():\n"
        "    with socket.socket() as s:\n"
        "        request = struct.pack('16sH14x', b'ecat-master', 0)\n"
        "        return struct.unpack('16xH14x', fcntl.ioctl(s, 0x8913, request))[0]\n"
        "before = flags()\n"
        "subprocess.run([sys.executable, '-m', 'ecatd.service', '--interface', 'ecat-master',"
        " '--bus', 'tflags'])\n"
        "print(before == flags())\n"
    )
    result = run_module(
        "ecatsim",
        *("run", str(RIGS / "no_op.py"), "--", sys.executable, "-c", code),
        env={**os.environ, "ECATD_RUNTIME_DIR": str(tmp_path / "run")},
    )
    assert "does not reach OP" in result.stderr, "the daemon has come that far"
    assert result.stdout == "True\n", result.stderr


def test_r09_a_slave_that_does_not_reach_op(env: dict[str, str]) -> None:
    text = refused(7, "--simulate", str(RIGS / "no_op.py"), "--bus", "tnoop", env=env)
    names(text, "slave 1 (EL2008)", "OP", "SAFEOP+ERROR", "AL status 0x001D")


SILENT = """
[gateway]
listen = []
[[domain]]
name = "others"
[[domain]]
name = "silent"
slaves = [3]
[[outputs.safe]]
slave = 4
value = "hold"
[[signal]]
slave = 3
entry = "0x6000:11"
scale = 0.5
"""


def test_slaves_that_do_not_answer_their_mailboxes(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon(str(RIGS / "silent.py"), config=SILENT)
    told = [line for line in daemon.log.splitlines() if "mailbox" in line]
    used = ("is used", "EEPROM")
    cure = "restart ecatd"
    names(told[0], "ecatd: warning: slave 2", "0x1C12:00", "slave 2 (EL3008)", *used, cure)
    names(told[1], "slave 3 (EL3008)", "PREOP", "no process data", cure)
    names(told[2], "slave 4 (EL4008)", "PREOP", "SAFEOP", "PREOP+ERROR", cure)
    assert len(told) == 3
    with daemon.client() as client:
        states = [slave.al_state for slave in client.slaves()]
        assert states == [AlState.OP] * 3 + [AlState.PREOP] * 2 + [AlState.OP]
        value = client.signal(2, 0x6000, 0x11)

        def all_is_well() -> bool:
            client.wait()
            client.sample()
            return client.domain(0).wkc_state == WkcState.COMPLETE and value.raw == 16384

        wait_for(all_is_well, daemon)
    rows = {row["position"]: row for row in daemon.slave_rows("slaves")}
    assert [rows[n]["recovery"] for n in range(6)] == ["", "", "silent", "silent", "silent", ""]
    assert [rows[n]["input_bytes"] for n in (1, 2, 3)] == [32, 32, 0]
    names(rows[2]["recovery_text"], "mailbox", "answer", *used)
    assert " PREOP, silent " in daemon.ctl("slaves").stdout
    names(daemon.ctl("state").stdout, "OP; silent; " + rows[2]["recovery_text"])
    assert "slaves 2-4: silent" in daemon.ctl("info").stdout
    result = daemon.ctl("sdo-read", "2", "0x1018", "1", check=False)
    assert result.returncode == 4
    assert "Traceback" not in daemon.log


def test_a_slave_that_answers_nonsense_holds_nobody_up(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon(str(RIGS / "nonsense.py"))
    rows = daemon.slave_rows("state")
    assert [row["text"] for row in rows] == ["OP", "OP", "OP"]
    assert [row["recovery"] for row in rows] == ["", "silent", ""]
    names(rows[1]["recovery_text"], "mailbox", "nonsense", "is used", "EEPROM")
    (told,) = (line for line in daemon.log.splitlines() if "slave 1 (EL3008)" in line)
    assert "slave 1, 0x1C12:0" in told
    names(told, "is used", "EEPROM")


def test_a_silent_slave_comes_back_to_op(
    start_daemon: Callable[..., Daemon], monkeypatch: pytest.MonkeyPatch
) -> None:
    daemon = start_daemon(str(RIGS / "silent.py"))
    monkeypatch.setenv("ECATD_RUNTIME_DIR", daemon.env["ECATD_RUNTIME_DIR"])

    def condition() -> str:
        row = remote.request(ReadStates())["slaves"][2]
        return f"{row['text']}, {row['recovery']}"

    simulated = Simulator(str(daemon.child_pid("ecatsim")))
    with Remote(daemon.bus) as remote, simulated as simulator:
        wait_for(lambda: condition() == "OP, silent", daemon)
        simulator.faults.power_off(2)
        wait_for(lambda: condition() == "no answer, missing", daemon)
        simulator.faults.power_on(2)
        wait_for(lambda: condition() == "OP, silent", daemon)
        simulator.faults.power_off(2)
        wait_for(lambda: condition() == "no answer, missing", daemon)
        simulator.faults.mailbox(2, "none")
        simulator.faults.power_on(2)
        wait_for(lambda: condition() == "OP, ", daemon)
        assert remote.sdo_read(2, 0x1018, 1).data == b"\x02\0\0\0"


def test_an_emergency_while_slaves_are_read(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon(str(RIGS / "emergency.py"))
    (told,) = (line for line in daemon.log.splitlines() if "emergency" in line)
    names(told, "warning", "slave 0 (Gold EtherCAT GCON Drive)", "0x3220", "0x04")


def test_a_second_daemon_on_the_same_name(troll: Daemon, tmp_path: Path) -> None:
    result = run_module(
        "ecatd.service",
        *("--simulate", "line:1", "--bus", troll.bus),
        env={**troll.env, "ECATD_RUNTIME_DIR": str(tmp_path / "other")},
    )
    assert result.returncode == 7
    text = one_line_error(result.stderr, "ecatd")
    server = troll.child_pid("ecatd.server")
    names(text, f"'{troll.bus}'", f"pid {server}", "--bus", f"'systemctl stop ecatd@{troll.bus}'")
    # The first one has not noticed.
    assert troll.ctl_json("stats")["state"] == "running"


def test_a_second_daemon_on_the_same_interface(tmp_path: Path) -> None:
    """The first one must not notice; so it runs on an interface that both can see."""
    script = tmp_path / "two.sh"
    # Names with $$, since shared memory is common to all who run tests on this machine.
    script.write_text(
        """\
cd "$1"
export ECATD_RUNTIME_DIR="$1/run"
"$2" -m ecatd.service --interface ecat-master --bus tfirst$$ 2> first &
first=$!
trap 'kill $first 2> /dev/null' EXIT
until "$2" -m ecatd.cli info --bus tfirst$$ > /dev/null 2>&1; do kill -0 $first || exit 1; done
"$2" -m ecatd.service --interface ecat-master --bus tsecond$$ 2> second
echo "second $?"
"$2" -m ecatd.cli state --bus tfirst$$
"$2" -m ecatd.service --interface ecat-master --bus tfirst$$ 2> third
echo "third $?"
"$2" -m ecatd.cli state --bus tfirst$$
kill $first
wait $first
echo "first $?"
"""
    )
    result = run_module(
        "ecatsim", "run", "troll", "--", "sh", str(script), str(tmp_path), sys.executable
    )
    assert "second 7" in result.stdout, result.stdout + result.stderr
    assert "third 7" in result.stdout
    assert "first 0" in result.stdout
    assert result.stdout.count("OP") == 16, result.stdout
    names((tmp_path / "second").read_text(), "interface", "'ecat-master'", "another ecatd")
    names((tmp_path / "third").read_text(), "bus", "another ecatd", "--bus")


def test_modules_are_not_taken_from_the_current_directory(
    env: dict[str, str], tmp_path: Path
) -> None:
    (tmp_path / "pysoem.py").write_text("raise SystemExit('taken from the current directory')")
    (tmp_path / "msgpack.py").write_text("raise SystemExit('taken from the current directory')")
    result = subprocess.run(
        [sys.executable, "-P", "-m", "ecatd.service", "--simulate", "empty", "--bus", "tcwd"],
        cwd=tmp_path,
        env=env,
        text=True,
        capture_output=True,
        check=False,
    )
    assert result.returncode == 3, result.stderr
    assert "current directory" not in result.stderr


def test_unknown_rig(env: dict[str, str]) -> None:
    result = run_module("ecatd.service", "--simulate", "nonsense", env=env)
    assert result.returncode == 2
    names(result.stderr, "rig", "'nonsense'", "ecatsim rigs")


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("cycle_time = 1", "{file}:1: cycle_time: | 'cycle_time_us'"),
        ("[realtime\n", "{file}:1: | TOML"),
        ("\n\ncycle_time_us = 1", "{file}:3: cycle_time_us: | 1 | 100"),
    ],
)
def test_broken_configuration(env: dict[str, str], tmp_path: Path, text: str, what: str) -> None:
    file = tmp_path / "ecat.toml"
    file.write_text(text)
    for more in ((), ("--check-config",)):
        said = refused(2, "--simulate", "troll", "--config", str(file), *more, env=env)
        names(said, *what.format(file=file).split(" | "))


def test_configuration_that_does_not_fit_the_bus(env: dict[str, str], tmp_path: Path) -> None:
    file = tmp_path / "ecat.toml"
    file.write_text("[[outputs.safe]]\nslave = 2\nvalue = 'hold'\n")
    text = refused(2, "--simulate", "troll", "--config", str(file), "--bus", "tfit", env=env)
    names(text, "outputs.safe", "slave 2 (EL1018)", "no outputs")


def test_a_second_interface_where_the_rig_is_no_ring(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("line:1", config="second_interface = 'eth9'\n[gateway]\nlisten = []\n")
    (told,) = (line for line in daemon.log.splitlines() if "second_interface" in line)
    names(told, "warning", "second_interface = 'eth9'", "'line:1'", "not a ring")


def test_who_reads_that_the_bus_is_in_op_may_ask_for_it(
    start_daemon: Callable[..., Daemon], monkeypatch: pytest.MonkeyPatch
) -> None:
    daemon = start_daemon("line:1", ready=False)
    monkeypatch.setenv("ECATD_RUNTIME_DIR", daemon.env["ECATD_RUNTIME_DIR"])
    wait_for(lambda: "is in OP" in daemon.log, daemon)
    with Remote(daemon.bus) as remote:
        assert remote.request(ReadStates())["slaves"][0]["al_state"] == AlState.OP


def test_who_asks_a_daemon_that_starts_is_told_so(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon(str(RIGS / "silent.py"), ready=False)  # its start takes seconds
    wait_for(lambda: "6 slaves found" in daemon.log, daemon)
    server = daemon.child_pid("ecatd.server")
    os.kill(server, signal.SIGSTOP)
    try:
        result = daemon.ctl("state", check=False)
        folder = Path(daemon.env["ECATD_RUNTIME_DIR"]) / daemon.bus
        write_record(folder, FailureRecord(3, time.time(), "no carrier on 'eth7'"))
        again = daemon.ctl("state", check=False)
    finally:
        os.kill(server, signal.SIGCONT)
    for told in (result, again):
        assert told.returncode == 3
        names(one_line_error(told.stderr, "ecatctl"), f"'{daemon.bus}'", "still starting")
    names(again.stderr, "failed 3 times", "no carrier on 'eth7'")


def test_a_bus_of_one_slave(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("line:1")
    (told,) = (line for line in daemon.log.splitlines() if "is in OP" in line)
    names(told, "1 slave", "32 bytes of outputs", "32 of inputs", f"{CYCLE_TIME_US} µs")
    assert daemon.stop() == 0


def test_what_the_command_line_says_is_checked_as_the_file_is(env: dict[str, str]) -> None:
    text = refused(2, "--simulate", "troll", "--cycle-time-us", "5", env=env)
    names(text, "error: command line: cycle_time_us:", 5, 100, 1000000)


def test_a_place_for_sockets_that_cannot_be_had(env: dict[str, str]) -> None:
    text = refused(6, "--simulate", "troll", env=env | {"ECATD_RUNTIME_DIR": "/proc/x"})
    names(text, "/proc/x", "ECATD_RUNTIME_DIR")


def test_no_bus_is_named(env: dict[str, str]) -> None:
    text = refused(2, env=env)
    names(text, "--interface IF", "--simulate troll")


def test_ecatctl_without_a_daemon(env: dict[str, str]) -> None:
    result = run_module("ecatd.cli", "slaves", "--bus", "nobody", env=env)
    assert result.returncode == 3
    text = one_line_error(result.stderr, "ecatctl")
    names(text, "'nobody'", "systemctl start ecatd")


def test_sigterm_while_starting_leaves_nothing(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("line:64", ready=False)
    while "64 slaves found" not in daemon.log:
        assert daemon.process.poll() is None
    assert daemon.stop() == 0
    assert not list(SHM.glob(f"{daemon.bus}*"))


def test_sigterm_while_mailboxes_do_not_answer(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon(str(RIGS / "silent.py"), ready=False)
    while "6 slaves found" not in daemon.log:
        assert daemon.process.poll() is None
    assert daemon.stop() == 0
    assert "error" not in daemon.log
    assert not list(SHM.glob(f"{daemon.bus}*"))


def test_sigterm_while_slaves_do_not_answer(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("line:64", ready=False)
    while "64 slaves found" not in daemon.log:
        assert daemon.process.poll() is None
    simulator, server = daemon.child_pid("ecatsim"), daemon.child_pid("ecatd.server")
    os.kill(simulator, signal.SIGSTOP)
    try:
        daemon.process.terminate()
        while Path(f"/proc/{server}").exists():
            assert daemon.process.poll() is None
    finally:
        os.kill(simulator, signal.SIGCONT)
    assert daemon.process.wait() == 0
    assert "Traceback" not in daemon.log
    assert "is killed" not in daemon.log
    assert not list(SHM.glob(f"{daemon.bus}*"))


def test_ctrl_c_ends_everything(start_daemon: Callable[..., Daemon], tmp_path: Path) -> None:
    daemon = start_daemon("troll")
    pids = [daemon.child_pid("ecatd.server"), daemon.child_pid("ecatd.gateway")]
    daemon.process.send_signal(signal.SIGINT)
    assert daemon.process.wait() == 0
    assert not [pid for pid in pids if Path(f"/proc/{pid}").exists()]
    assert not list(SHM.glob(f"{daemon.bus}*"))
    assert not list((tmp_path / "d0" / "r").iterdir())


def test_closed_standard_streams_become_no_other_files(tmp_path: Path) -> None:
    """A program that was started without them must not write its messages into a socket."""
    bus = f"closed{os.getpid()}"
    env = {**os.environ, "ECATD_RUNTIME_DIR": str(tmp_path)}
    command = f"exec {sys.executable} -m ecatd.service --simulate troll --bus {bus}"
    with subprocess.Popen(["sh", "-c", f"{command} <&- >&- 2>&-"], env=env) as daemon:
        try:
            while run_module("ecatd.cli", "check", "--bus", bus, env=env).returncode:
                assert daemon.poll() is None
            pids = [daemon.pid, *children(daemon.pid)]
            titles = [Path(f"/proc/{pid}/cmdline").read_text().split("\0")[0] for pid in pids[1:]]
            assert sorted(titles) == ["ecatd.gateway", "ecatd.server", "ecatsim"]
            assert {str(Path(f"/proc/{pid}/fd/2").readlink()) for pid in pids} == {os.devnull}
        finally:
            daemon.terminate()
    assert daemon.returncode == 0


@contextlib.contextmanager
def killed_early(title: str, runtime: Path) -> Iterator[subprocess.Popen[str]]:
    """An `ecatd` whose child of this title is killed while the bus starts."""
    env = {**os.environ, "ECATD_RUNTIME_DIR": str(runtime)}
    command = [sys.executable, "-m", "ecatd.service", "--simulate", "line:1"]
    with subprocess.Popen(
        [*command, "--bus", f"early{os.getpid()}"], env=env, stderr=subprocess.PIPE, text=True
    ) as daemon:
        killed = False
        while not killed and daemon.poll() is None:
            for pid in children(daemon.pid):
                with suppress(FileNotFoundError):
                    if Path(f"/proc/{pid}/cmdline").read_text().startswith(f"{title}\0"):
                        os.kill(pid, signal.SIGKILL)
                        killed = True
        yield daemon


@pytest.mark.parametrize(
    ("title", "name"), [("ecatsim", "simulator"), ("ecatd.server", "bus server")]
)
def test_a_child_that_is_killed_while_the_bus_starts_is_named(
    title: str, name: str, tmp_path: Path
) -> None:
    with killed_early(title, tmp_path) as daemon:
        _, log = daemon.communicate()
    assert daemon.returncode == 70
    assert f"the {name} has ended unexpectedly (signal 9)" in log


def test_r18_a_gateway_that_is_killed_while_the_bus_starts_is_started_again(
    tmp_path: Path,
) -> None:
    with killed_early("ecatd.gateway", tmp_path) as daemon:
        assert daemon.stderr is not None
        lines = []
        for line in daemon.stderr:
            lines.append(line)
            if "is in OP" in line:
                daemon.terminate()
        log = "".join(lines)
        names(log, "the gateway has ended (signal 9)", "starts it again", "is in OP")
        assert "defect" not in log
    assert daemon.returncode == 0


def test_a_log_on_a_full_disk_ends_no_bus(tmp_path: Path) -> None:
    bus = f"full{os.getpid()}"
    env = {**os.environ, "ECATD_RUNTIME_DIR": str(tmp_path)}
    command = [sys.executable, "-m", "ecatd.service", "--simulate", "troll", "--bus", bus]
    with Path("/dev/full").open("w") as full:
        daemon = subprocess.Popen(command, env=env, stderr=full)
    with daemon:
        try:
            while run_module("ecatd.cli", "check", "--bus", bus, env=env).returncode:
                assert daemon.poll() is None
        finally:
            daemon.terminate()
    assert daemon.returncode == 0


@pytest.mark.parametrize("option", ["--check-config", "--describe"])
def test_an_output_that_cannot_be_written(option: str) -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "ecatd.service", option, "--simulate", "line:1"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 7
    assert "Traceback" not in done.stderr
    assert "the output cannot be written: No space left" in done.stderr


def test_setpriv_and_unshare_are_there() -> None:
    """They come with util-linux, which every Debian has; the tests above rely on them."""
    assert shutil.which("unshare")
    assert shutil.which("setpriv")


def test_a_service_manager_that_is_gone_ends_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from ecatd.base.notify import notify

    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "gone"))
    notify("STOPPING=1")
