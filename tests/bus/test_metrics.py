"""The metrics for Prometheus: by `ecatctl metrics`, and over HTTP while faults happen."""

import json
import os
import re
import signal
import socket
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest
from prometheus_client.openmetrics.parser import text_string_to_metric_families
from test_check_command import WITHOUT_A_SLAVE

from conftest import Daemon, free_port, names, stop_process, wait_for
from ecatsim.control import Simulator

pytestmark = pytest.mark.bus

CONFIG = """
[gateway]
listen = []
metrics = "{address}"
[recovery]
slaves = "none"
[[slave]]
position = 1
name = "lamps"
watchdog_ms = 5000
"""

Values = dict[tuple[str, frozenset[tuple[str, str]]], float]


def parsed(text: str) -> Values:
    """All samples of a scrape, by name and labels, as the reference parser reads them."""
    return {
        (sample.name, frozenset(sample.labels.items())): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


def serve(start: Callable[..., Daemon], folder: Path) -> tuple[Daemon, str]:
    """A daemon that serves metrics, and the address of the server."""
    rig = folder / "rig.toml"
    rig.write_text("".join(f'[[slave]]\ndevice = "{kind}"\n' for kind in ("EK1100", "EL2008")))
    address = f"127.0.0.1:{free_port()}"
    return start(str(rig), config=CONFIG.format(address=address)), f"http://{address}"


@pytest.fixture(scope="module")
def served(
    start_shared: Callable[..., Daemon], tmp_path_factory: pytest.TempPathFactory
) -> tuple[Daemon, str]:
    """The same for the tests that leave it as they found it."""
    return serve(start_shared, tmp_path_factory.mktemp("served"))


def scrape(url: str) -> Values:
    with urlopen(f"{url}/metrics", timeout=30) as answer:
        assert answer.headers["Content-Type"].startswith("application/openmetrics-text")
        return parsed(answer.read().decode())


def told(daemon: Daemon) -> dict[str, float]:
    """What `ecatctl metrics` says of the whole bus."""
    labels = frozenset({("bus", daemon.bus)})
    values = parsed(daemon.ctl("metrics", "--timeout", "5").stdout)
    return {name: value for (name, given), value in values.items() if given == labels}


def problems(daemon: Daemon) -> int:
    """How many `ecatctl check` names."""
    return len(json.loads(daemon.ctl("check", "--json", check=False).stdout)["problems"])


def test_what_prometheus_sees_of_a_fault(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    daemon, url = serve(start_daemon, tmp_path)

    def value(metric: str, **labels: str) -> float:
        return scrape(url)[metric, frozenset({"bus": daemon.bus, **labels}.items())]

    assert value("ecat_up") == 1
    assert value("ecat_slave_in_op", slave="1", name="lamps (EL2008)") == 1
    assert value("ecat_problems") == problems(daemon) == 0
    assert value("ecat_slaves_required") == value("ecat_slaves_in_op") == 2
    before = value("ecat_cycles_total")
    wait_for(lambda: value("ecat_cycles_total") > before, daemon)
    with Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
        simulator.faults.power_off(1)
        wait_for(lambda: value("ecat_slaves_found") == 1, daemon)
        wait_for(lambda: value("ecat_slave_in_op", slave="1", name="lamps (EL2008)") == 0, daemon)
        assert value("ecat_problems") == problems(daemon) == 1
        assert value("ecat_slaves_in_op") == 1
    assert value("ecat_wkc_bad_total") > 0
    assert value("ecat_domain_wkc_bad_total", domain="0", name="") > 0


def test_slaves_that_were_missing_at_the_start(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text('[[slave]]\ndevice = "EK1100"\n')
    daemon = start_daemon(str(rig), config=WITHOUT_A_SLAVE)
    found = told(daemon)
    assert (found["ecat_slaves_required"], found["ecat_slaves_in_op"]) == (2, 1)
    assert (found["ecat_slaves_missing"], found["ecat_slaves_expected"]) == (1, 1)
    assert found["ecat_problems"] == problems(daemon) == 1


def test_a_ring_that_opens(start_daemon: Callable[..., Daemon], tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text("ring = true\n" + "[[slave]]\ndevice = 'Loopback32'\n" * 2)
    daemon = start_daemon(str(rig))
    wait_for(lambda: told(daemon)["ecat_ring_closed"] == 1, daemon)
    wait_for(lambda: told(daemon)["ecat_problems"] == problems(daemon) == 0, daemon)
    with Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
        simulator.faults.break_link(1)
        wait_for(lambda: told(daemon)["ecat_ring_closed"] == 0, daemon)
        wait_for(lambda: told(daemon)["ecat_problems"] == problems(daemon) == 1, daemon)


def test_a_bus_server_that_does_not_answer(served: tuple[Daemon, str]) -> None:
    daemon, url = served
    stopped = [
        daemon.process.pid,
        daemon.child_pid("ecatd.server"),
    ]  # the first would kill the second
    for pid in stopped:
        stop_process(pid)
    try:
        found = scrape(url)
    finally:
        for pid in reversed(stopped):
            os.kill(pid, signal.SIGCONT)
    labels = frozenset({("bus", daemon.bus)})
    assert found["ecat_states_known", labels] == 0
    assert found["ecat_problems", labels] >= 1
    assert not {name for name, _ in found} & {"ecat_slaves_in_op", "ecat_slave_in_op"}


def test_the_command_prints_the_same(served: tuple[Daemon, str]) -> None:
    daemon, url = served
    found = parsed(daemon.ctl("metrics").stdout)
    assert found.keys() == scrape(url).keys()
    steps = [
        (float(dict(labels)["le"]), count)
        for (name, labels), count in found.items()
        if name == "ecat_cycle_seconds_bucket"
    ]
    counts = [count for _, count in sorted(steps)]
    assert counts == sorted(counts)
    assert counts[-1] == found["ecat_cycle_seconds_count", frozenset({("bus", daemon.bus)})] > 0
    done = daemon.ctl("metrics", "--json", check=False)
    assert done.returncode == 2
    names(done.stdout, "stats --json")


@pytest.mark.parametrize("file", ["ecatd.rules.yml", "grafana.json"])
def test_alerts_and_dashboard_name_what_there_is(served: tuple[Daemon, str], file: str) -> None:
    daemon, _ = served
    text = (Path(__file__).parents[2] / "monitoring" / file).read_text()
    asked = set(re.findall(r"\becat_[a-z_]+", text))
    there = {name for name, _ in parsed(daemon.ctl("metrics").stdout)}
    assert asked
    # Only with distributed clocks, with a second interface, and with a fault.
    assert asked - there <= {"ecat_dc_locked", "ecat_ring_closed", "ecat_fault"}


@pytest.mark.parametrize(
    ("method", "path", "status"), [("GET", "/", 404), ("POST", "/metrics", 405)]
)
def test_wrong_requests(served: tuple[Daemon, str], method: str, path: str, status: int) -> None:
    _, url = served
    with pytest.raises(HTTPError) as refused:
        urlopen(Request(url + path, method=method), timeout=30)
    with refused.value as answer:
        assert answer.code == status


def test_nonsense_costs_nothing(served: tuple[Daemon, str]) -> None:
    daemon, url = served
    host, port = url.removeprefix("http://").split(":")
    for nonsense in (b"\r\n\r\n", b"\0" * 20_000, b"GET", b"GET /metrics HTTP/1.1\r\n\r\n"):
        with socket.create_connection((host, int(port))) as client:
            client.sendall(nonsense)
    assert scrape(url)
    assert "Traceback" not in daemon.log


def test_connections_without_a_request_keep_nobody_out(served: tuple[Daemon, str]) -> None:
    _, url = served
    host, port = url.removeprefix("http://").split(":")
    with ExitStack() as idle:
        for _ in range(60):
            idle.enter_context(socket.create_connection((host, int(port))))
        assert scrape(url)


def test_a_unix_socket(start_daemon: Callable[..., Daemon], tmp_path: Path) -> None:
    path = tmp_path / "metrics"
    daemon = start_daemon("line:1", config=CONFIG.format(address=f"unix:{path}").split("[[")[0])
    with socket.socket(socket.AF_UNIX) as client:
        client.connect(str(path))
        client.sendall(b"GET /metrics HTTP/1.0\r\n\r\n")
        answer = b"".join(iter(lambda: client.recv(65536), b"")).decode()
    assert answer.startswith("HTTP/1.1 200 OK\r\n")
    assert parsed(answer.split("\r\n\r\n", 1)[1])["ecat_up", frozenset({("bus", daemon.bus)})] == 1
    assert path.stat().st_mode & 0o777 == 0o660


def test_an_address_in_use_costs_only_the_metrics(
    served: tuple[Daemon, str], start_daemon: Callable[..., Daemon]
) -> None:
    _, url = served
    address = url.removeprefix("http://")
    second = start_daemon("line:1", config=CONFIG.format(address=address).split("[[")[0])
    names(second.log, f"no metrics on {address}", "in use")
    assert len(second.slave_rows()) == 1


def test_an_address_that_is_free_later(start_daemon: Callable[..., Daemon]) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        address = f"127.0.0.1:{other.getsockname()[1]}"
        daemon = start_daemon("line:1", config=CONFIG.format(address=address).split("[[")[0])
        names(daemon.log, f"no metrics on {address}", "already in use", "tried again")
    wait_for(lambda: f"ecatd: metrics on {address}" in daemon.log, daemon)
    with urlopen(f"http://{address}/metrics") as answer:
        assert answer.status == 200


def test_a_file_at_the_address_stays(start_daemon: Callable[..., Daemon], tmp_path: Path) -> None:
    file = tmp_path / "notes.txt"
    file.write_text("mine")
    daemon = start_daemon("line:1", config=CONFIG.format(address=f"unix:{file}").split("[[")[0])
    names(daemon.log, f"no metrics on unix:{file}", "in use")
    assert daemon.stop() == 0
    assert file.read_text() == "mine"
