"""A real Prometheus, with our rules, scrapes ecatd while faults happen."""

import json
import re
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
from test_metrics import CONFIG

from conftest import PATIENCE, Daemon, free_port, names
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


WELL = {
    'up{job="ecatd",instance="here"}': "1x99",
    'ecat_up{bus="b"}': "1x99",
    'ecat_states_known{bus="b"}': "1x99",
    'ecat_problems{bus="b"}': "0x99",
    'ecat_slave_in_op{bus="b",slave="1",name="lamps"}': "1x99",
    'ecat_slaves_missing{bus="b"}': "0x99",
    'ecat_link_up{bus="b",interface="first"}': "1x99",
    'ecat_ring_closed{bus="b"}': "1x99",
    'ecat_foreign_total{bus="b"}': "3x99",
    'ecat_dc_locked{bus="b"}': "1x99",
    'ecat_lost_total{bus="b"}': "5x99",
    'ecat_missed_total{bus="b"}': "5x99",
    'ecat_domain_well{bus="b",domain="0"}': "1x99",
    'ecat_fault{bus="b",kind="mtu",interface="eth1"}': "0x99",
    'ecat_lapses_total{bus="b"}': "5x99",
}
"""What is scraped every 5 s of a bus that is well."""
FAULTS = {
    "EtherCATUnknown": ("up", "0x99", "here gives no metrics: ecatd or its gateway does not run"),
    "EtherCATNotScraped": (
        "up",
        "_x99",
        "Prometheus asks no ecatd for metrics: see its scrape_configs",
    ),
    "EtherCATDown": ("ecat_up", "0x99", "bus b is not exchanged"),
    "EtherCATNoAnswer": (
        "ecat_states_known",
        "0x99",
        "bus b: the bus server does not say how the slaves are",
    ),
    "EtherCATDegraded": (
        "ecat_problems",
        "2x99",
        "bus b: ecatctl check names what is wrong (problems: 2)",
    ),
    "EtherCATSlaveNotInOp": ("ecat_slave_in_op", "0x99", "bus b: slave 1, lamps, is not in OP"),
    "EtherCATSlavesMissing": (
        "ecat_slaves_missing",
        "2x99",
        "bus b has started without 2 of its slaves",
    ),
    "EtherCATNoCarrier": ("ecat_link_up", "0x99", "bus b: the first interface has no carrier"),
    "EtherCATRingOpen": (
        "ecat_ring_closed",
        "0x99",
        "bus b: the ring is open, so the next break cuts off slaves",
    ),
    "EtherCATForeignMaster": (
        "ecat_foreign_total",
        "3x49 4x49",
        "bus b: another master sends frames, see ecatctl events",
    ),
    "EtherCATClocksNotLocked": (
        "ecat_dc_locked",
        "0x99",
        "bus b: the cycle does not follow the reference clock",
    ),
    "EtherCATExchangeFails": (
        "ecat_domain_well",
        "0x99",
        "bus b: exchanges of domain 0 fail: ecatctl check says why",
    ),
    "EtherCATInterface": (
        "ecat_fault",
        "1x99",
        "bus b: interface eth1 is not as EtherCAT needs it (mtu): see ecatctl check",
    ),
    "EtherCATFramesLost": ("ecat_lost_total", "5+10x99", "bus b loses 2 frames a second"),
    "EtherCATCyclesMissed": (
        "ecat_missed_total",
        "5+10x99",
        "bus b misses 2 cycles a second: see ecatctl stats",
    ),
    "EtherCATClientsLapse": (
        "ecat_lapses_total",
        "5x49 6x49",
        "bus b: a client lost its outputs because it did not answer in time",
    ),
}
"""By alert: the metric that makes it fire, its values, and what the alert says."""


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
    address = f"127.0.0.1:{free_port()}"
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


def test_each_alert_fires_with_its_fault_and_with_no_other(tmp_path: Path) -> None:
    severities = dict(
        re.findall(r"alert: (\w+).*?severity: (\w+)", RULES.read_text(), flags=re.DOTALL)
    )
    assert severities.keys() == FAULTS.keys()
    tests = []
    for fault, (metric, values, summary) in [("", ("", "", "")), *FAULTS.items()]:
        series = {name: values if name.startswith(f"{metric}{{") else WELL[name] for name in WELL}
        (labels,) = [
            dict(re.findall(r'(\w+)="(\w+)"', name))
            for name in WELL
            if name.startswith(f"{metric or 'ecat_up'}{{")
        ]
        if fault == "EtherCATNotScraped":
            del labels["instance"]
        fires = {
            "exp_labels": {**labels, "severity": severities.get(fault)},
            "exp_annotations": {"summary": summary},
        }
        tests.append(
            {
                "interval": "5s",
                "input_series": [{"series": name, "values": series[name]} for name in series],
                "alert_rule_test": [
                    {
                        "eval_time": "7m",
                        "alertname": alert,
                        "exp_alerts": [fires] if alert == fault else [],
                    }
                    for alert in FAULTS
                ],
            }
        )
    file = tmp_path / "test.yml"
    document = {"rule_files": [str(RULES)], "evaluation_interval": "5s", "tests": tests}
    file.write_text(json.dumps(document))  # JSON is YAML, too
    done = subprocess.run(
        ["promtool", "test", "rules", file], check=False, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_alerts_fire_and_end_with_their_faults(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text("".join(f'[[slave]]\ndevice = "{kind}"\n' for kind in ("EK1100", "EL2008")))
    ecatd = f"127.0.0.1:{free_port()}"
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
