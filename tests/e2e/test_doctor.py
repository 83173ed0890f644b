"""`ecatctl doctor` on interfaces of a network namespace, on this machine, and on what is wrong."""

import json
import os
import shlex
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from conftest import PYTHON, SHM, Daemon, names
from ecatd.admin.doctor.costs import COSTS

pytestmark = pytest.mark.bus

CTL = f"{PYTHON} -m ecatd.cli doctor"
needs_ethtool = pytest.mark.skipif(not shutil.which("ethtool"), reason="ethtool is not installed")
ORDINARY = [] if os.geteuid() else ["unshare", "--user", "--map-user=1000", "--map-group=1000"]
"""Runs a command without the rights of root."""
NAMES = ["area", "name", "level", "text", "remedy", "cost", "fixable"]


def namespace(script: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Runs a script in a network namespace with a pair of interfaces, `here` and `there`."""
    setup = "mount -t sysfs none /sys\n"  # that of the namespace
    setup += "ip link add here type veth peer name there && ip link set there up\n"
    root = [] if os.geteuid() == 0 else ["--user", "--map-root-user"]
    command = ["unshare", *root, "--net", "--mount", "sh", "-ec", setup + script]
    env = {**os.environ, "ECATD_RUNTIME_DIR": str(folder / "run")}
    return subprocess.run(command, capture_output=True, text=True, check=False, env=env)


def findings(text: str) -> dict[tuple[str, str], dict[str, Any]]:
    document = json.loads(text)
    assert document["schema"] == 1
    assert all(list(item) == NAMES for item in document["findings"])
    return {(item["area"], item["name"]): item for item in document["findings"]}


def test_an_interface_without_a_carrier_and_with_an_address(tmp_path: Path) -> None:
    script = f"""
        {CTL} --interface here --json || true
        echo ---
        ip link set here up; ip link set there down; ip addr add 10.1.2.3/24 dev here
        {CTL} --interface here --json && exit 1
        test $? = 1
    """
    done = namespace(script, tmp_path)
    assert done.returncode == 0, done
    off, on = map(findings, done.stdout.split("---"))
    assert "switched off" in off["interface here", "link"]["text"]
    assert off["interface here", "IP addresses"]["level"] == "ok"
    assert on["interface here", "link"]["level"] == "problem"
    assert "cable" in on["interface here", "link"]["remedy"]
    assert "10.1.2.3" in on["interface here", "IP addresses"]["text"]


def test_a_user_of_the_service_that_is_missing_is_named(tmp_path: Path) -> None:
    script = f"""
        for file in passwd group; do
            grep -v ^ecat /etc/$file >{tmp_path}/$file; mount --bind {tmp_path}/$file /etc/$file
        done
        {CTL} --json || true
        echo ---
        echo ecat:x:995: >>/etc/group
        {CTL} --json && exit 1
        test $? = 1
    """
    done = namespace(script, tmp_path)
    assert done.returncode == 0, done
    none, some = map(findings, done.stdout.split("---"))
    assert ("service", "users and groups") not in none
    found = some["service", "users and groups"]
    assert found["level"] == "problem"
    for name in ("user 'ecatd'", "user 'ecatd-gateway'", "group 'ecatd-gateway'"):
        assert name in found["text"]
    assert "group 'ecat'" not in found["text"]


@needs_ethtool
def test_what_is_changed_can_be_changed_back(tmp_path: Path) -> None:
    kept = tmp_path / "ecatd-doctor.json"
    script = f"""
        look() {{ ethtool -k here | grep ^generic-receive-offload; }}
        ip link set here up; ethtool -K here gro on
        {CTL} --interface here --fix || true
        look
        {CTL} --interface here --fix || true
        cat {kept}
        {CTL} --interface here --undo || true
        look
        test ! -e {kept}
        {CTL} --interface here --undo || true
    """
    done = namespace(script, tmp_path)
    assert done.returncode == 0, done
    begins = ("here gro", ' "here gro', "generic-receive-offload")
    lines = [line for line in done.stdout.splitlines() if line.startswith(begins)]
    assert lines == [
        "here gro: on -> off",
        "generic-receive-offload: off",
        ' "here gro": "on"',
        "here gro: off -> on",
        "generic-receive-offload: on",
    ]
    assert done.stdout.count("nothing to change") == 2


def test_a_damaged_list_of_changes_is_named(tmp_path: Path) -> None:
    for text in ("[]", "{", '{"here what": "1"}'):
        (tmp_path / "ecatd-doctor.json").write_text(text)
        done = namespace(f"{CTL} --interface here --undo", tmp_path)
        assert done.returncode == 7, (text, done)
        assert "ecatd-doctor.json" in done.stderr
        assert "Traceback" not in done.stderr


def run(*arguments: str, env: dict[str, str] | None = None) -> subprocess.CompletedProcess[str]:
    command = [*shlex.split(CTL), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=env)


def test_r43_the_configuration_says_what_is_looked_at(tmp_path: Path) -> None:
    file = tmp_path / "press.toml"
    file.write_text('interface = "absent7"\n[realtime]\ncpu = 1000\n')
    done = run("--config", str(file), "--json")
    assert done.returncode == 1
    found = findings(done.stdout)
    assert found["interface absent7", "interface"]["level"] == "problem"
    assert "lo" in found["interface absent7", "interface"]["text"]
    assert "1000" in found["processors", "CPU of the engine"]["text"]
    file.write_text("interfaces = 1\n")
    done = run("--config", str(file))
    assert done.returncode == 1
    assert "interfaces" in done.stdout
    done = run("--config", str(tmp_path / "none.toml"))
    assert done.returncode == 2
    assert "none.toml" in done.stderr


def test_what_a_setting_costs_is_that_of_the_page(tmp_path: Path) -> None:
    page = Path(__file__).parents[2] / "docs" / "performance" / "settings.json"
    rows = {case["settings"]: case for case in json.loads(page.read_text())["cases"]}
    tuning = (page.parents[1] / "tuning.md").read_text().splitlines()
    for key, cost in COSTS.items():
        (line,) = (line for line in tuning if line.startswith(f"| `{key}` |"))
        names(line, *(f"{exchange:.1f} µs" for exchange in cost.exchange_us))
        found = [rows[name][cost.load] for name in (cost.row, cost.better)]
        exchanges = [round(row["exchange_p99"] / 1000, 1) for row in found]
        missed = [round(1000 * row["missed_cycles"] / row["cycles"], 2) for row in found]
        assert (exchanges, missed) == ([*cost.exchange_us], [*cost.missed]), cost
    file = tmp_path / "slow.toml"
    file.write_text(
        'interface = "lo"\n[realtime]\npriority = 0\ndma_latency_us = -1\npoll_us = 0\ncpu = 0\n'
    )
    told = findings(run("--config", str(file), "--json").stdout)
    for key in ("priority", "dma_latency_us", "poll_us"):
        item = told["configuration", f"realtime.{key}"]
        assert (item["level"], item["cost"]) == ("hint", str(COSTS[key]))
        names(item["cost"], *COSTS[key].exchange_us)
    names(told["configuration", "realtime.priority"]["cost"], "7.27")
    cpu = told["processors", "CPU of the engine"]
    assert cpu["cost"] == (str(COSTS["cpu"]) if cpu["level"] == "hint" else "")
    assert str(COSTS["poll_us"]) in run("--config", str(file)).stdout
    file.write_text('interface = "lo"\n[realtime]\nbusy_receive = true\npoll_us = 0\n')
    told = findings(run("--config", str(file), "--json").stdout)
    assert ("configuration", "realtime.poll_us") not in told


def test_the_wake_up_test_writes_a_report(tmp_path: Path) -> None:
    out = tmp_path / "report.txt"
    done = run("--latency", "0.4", "-o", str(out), "--json")
    document = json.loads(done.stdout)
    assert [item["load"] for item in document["wakeups"]] == [False, True]
    for item in document["wakeups"]:
        assert item["samples"] == 200
        assert 0 < item["median_ns"] <= item["p99_ns"] <= item["max_ns"]
    text = out.read_text()
    names(text, "engine wakes up")
    assert "processors" in text
    done = run("-o", str(tmp_path / "no/report.txt"))
    assert done.returncode == 7
    assert "cannot be written" in done.stderr


def test_a_killed_daemon_leaves_memory_that_is_named(
    start_daemon: Callable[..., Daemon],
) -> None:
    daemon = start_daemon("line:1")
    found = findings(run("--bus", daemon.bus, "--json", env=daemon.env).stdout)
    assert found["service", "gateway"]["level"] == "ok"
    left = f"{SHM}/{daemon.bus}.out"

    def told() -> list[str]:
        document = json.loads(run("--json", env=daemon.env).stdout)
        return [item["text"] for item in document["findings"] if left in item["text"]]

    assert told() == []
    daemon.kill_all()
    shutil.rmtree(daemon.env["ECATD_RUNTIME_DIR"])  # as systemd does
    (text,) = told()
    names(text, left, f"'{daemon.bus}'")


def test_ordinary_users_are_told_that_they_may_write(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("line:1")
    command = [*ORDINARY, *shlex.split(CTL), "--bus", daemon.bus, "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=daemon.env)
    found = findings(done.stdout)["this user", "use of the bus"]
    assert found["level"] == "ok"
    assert "write outputs" in found["text"]


def test_r43_what_an_ordinary_user_lacks_is_named() -> None:
    limits = ["prlimit", "--rtprio=0", "--memlock=65536"]
    command = [*ORDINARY, *limits, *shlex.split(CTL), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    found = findings(done.stdout)
    for name, text, remedy in (
        ("real time", "limit 0:", "@ecat - rtprio 98"),
        ("locked memory", "limit 65536:", "@ecat - memlock unlimited"),
        ("raw frames", "no CAP_NET_RAW and no CAP_NET_ADMIN", "sudo"),
    ):
        item = found["this user", name]
        assert item["level"] == "hint"
        names(item["text"], text, "the service")
        assert remedy in item["remedy"]


@pytest.mark.skipif(os.geteuid() != 0, reason="only root has all rights")
def test_r43_root_lacks_nothing() -> None:
    found = findings(run("--json").stdout)
    for name in ("real time", "locked memory", "raw frames"):
        assert (found["this user", name]["level"], found["this user", name]["remedy"]) == ("ok", "")


def test_a_bus_without_a_gateway(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("line:1", "--no-gateway")
    done = run("--bus", daemon.bus, "--json", env=daemon.env)
    assert done.returncode == 1
    found = findings(done.stdout)
    assert found["service", f"bus {daemon.bus}"]["level"] == "ok"
    assert found["service", "gateway"]["level"] == "problem"
    assert f"ecatd-gateway@{daemon.bus}" in found["service", "gateway"]["remedy"]


@needs_ethtool
def test_what_is_gone_does_not_hold_up_the_rest(tmp_path: Path) -> None:
    kept = tmp_path / "ecatd-doctor.json"
    kept.write_text('{"gone0 gro": "on", "here gro": "on", "IRQ 99999": "1"}')
    done = namespace(f"ethtool -K here gro off; {CTL} --interface here --undo || true", tmp_path)
    names(done.stdout, "gone0 gro", "cannot be changed")
    assert "here gro: off -> on" in done.stdout
    assert "here gro" not in json.loads(kept.read_text())
    assert "gone0 gro" in json.loads(kept.read_text())


def test_a_report_into_a_device_leaves_the_device(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = subprocess.Popen(["cat", pipe], stdout=subprocess.PIPE, text=True)
    done = run("-o", str(pipe))
    assert done.returncode in (0, 1), done
    assert "processors" in reader.communicate(timeout=60)[0]
    assert pipe.is_fifo()


@pytest.mark.long
def test_the_wake_up_test_ends_with_its_command() -> None:
    process = subprocess.Popen([*shlex.split(CTL), "--latency", "60"], stdout=subprocess.DEVNULL)
    children: set[str] = set()
    while not children:
        text = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text()
        children = set(text.split())
    process.kill()
    process.wait()
    # Nobody may have waited for them yet, but they do nothing any more.
    while any(runs(child) for child in children):
        pass


def runs(pid: str) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
