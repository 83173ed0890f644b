"""Slaves whose vendors' files have unusual shapes reach OP and are exchanged, with their names."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from conftest import Daemon, names, wait_for
from ecatsim.control import Simulator

sys.path.insert(0, str(Path(__file__).parents[1] / "unit"))

from vendor_shapes import ENCODINGS, SHAPES, entry, esi, pdo

pytestmark = pytest.mark.bus

USED = [name for name, shape in SHAPES.items() if not shape.refused]
OWN = USED.index("Synapticon: entries with the index of a PDO")
CHINESE = len(USED)
OUT = pdo("RxPdo", 2, 0x1600, entry(0x7000, 1))


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("vendors")
    rows = []
    for number, name in enumerate(USED):
        (folder / f"{number}.xml").write_bytes(SHAPES[name].text.encode())
        rows.append(f'[[slave]]\nesi = "{number}.xml"\n')
    named = pdo("RxPdo", 2, 0x1600, entry(0x7000, 1, name="目标位置"))
    text = esi(encoding="GB2312", name=ENCODINGS["GB2312"]).replace(OUT, named)
    text = text.replace(">Shape<", f">{ENCODINGS['GB2312']}<").replace('"#x1"', '"#x2"')
    (folder / "chinese.xml").write_bytes(text.encode("gb2312"))
    rows.append('[[slave]]\nesi = "chinese.xml"\n')
    (folder / "rig.toml").write_text("".join(rows))
    return folder


@pytest.fixture(scope="module")
def daemon(files: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Daemon]:
    daemon = Daemon(tmp_path_factory.mktemp("daemon"), str(files / "rig.toml")).wait_ready()
    yield daemon
    assert daemon.stop() == 0
    daemon.close()


def test_all_reach_op(daemon: Daemon) -> None:
    rows = daemon.slave_rows("slaves")
    assert [(row["state"], row["recovery"]) for row in rows] == [("OP", "")] * len(rows)
    sizes = [(row["output_bytes"], row["input_bytes"]) for row in rows]
    assert sizes[:CHINESE] == [(SHAPES[name].outputs, SHAPES[name].inputs) for name in USED]


def test_entries_with_the_index_of_a_pdo_are_exchanged(daemon: Daemon) -> None:
    with daemon.client() as client, Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
        signals = {(s.slave, s.address): s for s in client.signals()}
        assert signals[OWN, "0x1A00:01"].signed
        client.claim(OWN, lease=30)
        client.signal(OWN, 0x1600, 1).raw = 0x1234
        client.commit()
        simulator.set(OWN, 0x1A00, 1, -5)

        def arrived() -> bool:
            client.wait()
            client.sample()
            there = simulator.get(OWN, 0x1600, 1)
            return (there, client.signal(OWN, 0x1A00, 1).raw) == (0x1234, -5)

        wait_for(arrived, daemon)
    mapped = daemon.ctl_json("sdo-read", str(OWN), "0x1600", "1")["value"]
    assert mapped == 0x16000110, "a master reads the mapping"


def test_names_of_any_script_live_on(daemon: Daemon, files: Path, tmp_path: Path) -> None:
    name = ENCODINGS["GB2312"]
    assert daemon.slave_rows("slaves")[CHINESE]["name"] == name
    names(daemon.ctl("pdos").stdout, name, "目标位置")
    config = tmp_path / "ecat0.toml"
    said = daemon.ctl("config", "init", "--esi", str(files), "-o", str(config)).stderr
    names(said, "ecatctl: warning:", f"{files / '0.xml'}:3:", "category 30")
    names(config.read_text(), name, "chinese.xml")
    daemon.ctl("generate", "Names", str(tmp_path / "library"))
    written = [file for file in (tmp_path / "library" / "Names").rglob("*") if file.is_file()]
    texts = [file.read_text(errors="replace") for file in written if file.suffix in (".mo", ".h")]
    assert any("目标位置" in text for text in texts)
    assert not [text for text in texts if "????" in text]
    refused = daemon.ctl(
        "config", "check", str(config), "--esi", str(files), "--strict", check=False
    )
    assert refused.returncode == 2
    assert f"ecatctl: {files}" in refused.stderr
