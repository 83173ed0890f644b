"""A real Prometheus, with our rules, scrapes ecatd while faults happen."""

import json
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.error import URLError
from urllib.request import urlopen

import pytest
from test_metrics import CONFIG, free_address

from conftest import PATIENCE, Daemon, names
from ecatsim.control import Simulator

pytestmark = [
    pytest.mark.bus,
    pytest.mark.long,
    pytest.mark.skipif(not shutil.which("prometheus"), reason="Prometheus is not installed"),
]

RULES = Path(__file__).parents[2] / "monitoring" / "ecatd.rules.yml"

PROMETHEUS = """
global: {{scrape_interval: 1s, evaluation_interval: 1s}}
rule_files: ["{rules}"]
scrape_configs:
  - job_name: ecatd
    static_configs: [{{targets: ["{ecatd}"]}}]
"""


class Prometheus:
    """A Prometheus server, asked over HTTP."""

    def __init__(self, address: str) -> None:
        self._api = f"http://{address}/api/v1"

    def ask(self, path: str) -> Any:
        """The data of an answer; None while the server does not answer."""
        try:
            with urlopen(f"{self._api}/{path}", timeout=PATIENCE) as answer:
                return json.load(answer)["data"]
        except URLError:
            return None

    def firing(self) -> dict[str, str]:
        """The summary of each alert that fires, by its name and the position of its slave."""
        found = (self.ask("alerts") or {"alerts": []})["alerts"]
        return {
            " ".join((a["labels"]["alertname"], a["labels"].get("slave", ""))).strip(): (
                a["annotations"]["summary"]
            )
            for a in found
            if a["state"] == "firing"
        }

    def wait(self, condition: Callable[[], bool]) -> None:
        """Waits until something has come about."""
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline, self.ask("alerts")
            time.sleep(0.2)


@contextmanager
def prometheus(folder: Path, ecatd: str) -> Iterator[Prometheus]:
    config = folder / "prometheus.yml"
    config.write_text(PROMETHEUS.format(rules=RULES, ecatd=ecatd))
    address = free_address()
    with (folder / "prometheus.log").open("w") as log:
        process = subprocess.Popen(
            [
                "prometheus",
                f"--config.file={config}",
                f"--storage.tsdb.path={folder / 'prometheus'}",
                f"--web.listen-address={address}",
            ],
            stderr=log,
        )
    try:
        yield Prometheus(address)
    finally:
        process.terminate()
        process.wait(PATIENCE)


def test_prometheus_takes_the_rules() -> None:
    done = subprocess.run(
        ["promtool", "check", "rules", RULES], check=False, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_alerts_fire_and_end_with_their_faults(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text("".join(f'[[slave]]\ndevice = "{kind}"\n' for kind in ("EK1100", "EL2008")))
    ecatd = free_address()
    config = CONFIG.format(address=ecatd).replace('slaves = "none"', 'slaves = "all"')
    daemon = start_daemon(str(rig), config=config)
    with prometheus(tmp_path, ecatd) as server:
        server.wait(lambda: bool((server.ask("query?query=ecat_up") or {}).get("result")))
        with Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
            simulator.faults.power_off(1)
            server.wait(lambda: "EtherCATSlaveNotInOp 1" in server.firing())
            told = server.firing()
            names(told["EtherCATSlaveNotInOp 1"], daemon.bus, "slave 1", "lamps")
            assert "EtherCATSlaveNotInOp 0" not in told
            simulator.faults.power_on(1)
            server.wait(lambda: not server.firing().keys() & {"EtherCATSlaveNotInOp 1"})
        assert daemon.stop() == 0
        server.wait(lambda: "EtherCATUnknown" in server.firing())
        names(server.firing()["EtherCATUnknown"], ecatd)
