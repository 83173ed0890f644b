"""`ecatctl sdos`, `sdo-dump` and `sdo-restore`: the objects of live slaves."""

import json
import re
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from conftest import Daemon, names, one_line_error
from ecatsim.control import Simulator

pytestmark = pytest.mark.bus

RIG = """
name = "objects"
[[slave]]
device = "EK1100"
[[slave]]
device = "EL3102"
[[slave]]
esi = "ESI"
type = "AX2"
revision = 0x00020001
"""
ESI = (Path(__file__).parents[1] / "unit" / "esi_sample.py").read_text().split('"""')[3]
INPUTS, AXIS = "1", "2"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("objects")
    (folder / "axis.xml").write_text(ESI)
    (folder / "rig.toml").write_text(RIG.replace("ESI", str(folder / "axis.xml")))
    return folder


@pytest.fixture(scope="module")
def bus(start_shared: Callable[..., Daemon], folder: Path) -> Daemon:
    return start_shared(str(folder / "rig.toml"))


@pytest.fixture
def simulator(bus: Daemon) -> Iterator[Simulator]:
    with Simulator(str(bus.child_pid("ecatsim"))) as simulator:
        yield simulator
        simulator.faults.mailbox(int(INPUTS), "none")


def test_objects_are_listed(bus: Daemon) -> None:
    text = bus.ctl("sdos", INPUTS).stdout
    assert text.splitlines()[0].split() == ["OBJECT", "TYPE", "ACCESS", "PDO", "NAME"]
    names(text, "0x1018", "Identity", "0x1018:01", "Vendor ID", "string(6)", "written in PREOP")
    found = bus.ctl_json("sdos", INPUTS, "0x8000", "--values")["objects"]
    assert [item["index"] for item in found] == [0x8000]
    gain = next(item for item in found[0]["entries"] if item["subindex"] == 0x12)
    assert (gain["type"], gain["access"], gain["pdo"]) == ("int32", "rw", "")
    assert (gain["value"], gain["data"]) == (0x10000, "00000100")
    value = bus.ctl_json("sdos", INPUTS, "0x6000", "--values")["objects"][0]["entries"][-1]
    assert (value["subindex"], value["pdo"]) == (0x11, "tx")
    assert value["physical"].endswith(" V")


def test_what_is_not_there_is_named(bus: Daemon) -> None:
    for arguments, status, tokens in (
        (("sdos", "0"), 7, ("slave 0 (EK1100)", "CoE")),
        (("sdos", INPUTS, "0x7777"), 5, ("0x7777", "0x06020000")),
        (("sdos", "9"), 7, ("slave 9",)),
    ):
        wrong = bus.ctl(*arguments, check=False)
        assert wrong.returncode == status, wrong.stderr
        names(one_line_error(wrong.stderr, "ecatctl"), *tokens)


@pytest.mark.long
def test_descriptions_are_kept(bus: Daemon, simulator: Simulator) -> None:
    before = bus.ctl_json("sdos", INPUTS, "0x8010")
    simulator.faults.mailbox(int(INPUTS), "stuck")
    assert bus.ctl_json("sdos", INPUTS, "0x8010") == before
    silent = bus.ctl("sdos", INPUTS, check=False)
    assert silent.returncode == 4, silent.stderr
    names(one_line_error(silent.stderr, "ecatctl"), "slave 1", "mailbox")


def test_an_esi_file_describes_objects(bus: Daemon, folder: Path) -> None:
    own = bus.ctl_json("sdos", AXIS, "0x2000")["objects"][0]
    esi = bus.ctl_json("sdos", AXIS, "0x2000", "--esi", str(folder))["objects"][0]
    for key in ("subindex", "type", "bits", "access"):
        assert [item[key] for item in esi["entries"]] == [item[key] for item in own["entries"]]
    other = bus.ctl("sdos", INPUTS, "--esi", str(folder), check=False)
    assert other.returncode == 7
    names(one_line_error(other.stderr, "ecatctl"), "slave 1 (EL3102)", "vendor")


def test_a_dump_is_restored(bus: Daemon, tmp_path: Path) -> None:
    file = tmp_path / "inputs.toml"
    names(bus.ctl("sdo-dump", INPUTS, "-o", str(file)).stdout, "slave 1 (EL3102)", file)
    saved = tomllib.loads(file.read_text())
    assert saved["slave"]["name"] == "EL3102"
    offset = next(item for item in saved["startup"] if item["object"] == "0x8000:11")
    assert (offset["type"], offset["value"]) == ("int16", 0)
    # What cannot be written, and what is decided by the configuration, is a comment.
    objects = {item["object"] for item in saved["startup"]}
    assert not objects & {"0x1018:01", "0x1C13:01", "0x6000:11"}
    names(file.read_text(), "# 0x1018:01", "# 0x6000:11", " V")
    names(bus.ctl("sdo-restore", INPUTS, str(file)).stdout, f"all {len(objects)} values")

    bus.ctl("sdo-write", INPUTS, "0x8000", "0x11", "5")
    asked = bus.ctl("sdo-restore", INPUTS, str(file), check=False)
    assert asked.returncode == 2
    names(asked.stdout, "0x8000:11", "5", "0", "differs")
    names(one_line_error(asked.stderr, "ecatctl"), "slave 1 (EL3102)", "--yes")
    assert bus.ctl("sdo-restore", INPUTS, str(file), "--dry-run").returncode == 0
    assert bus.ctl_json("sdo-read", INPUTS, "0x8000", "0x11")["value"] == 5
    done = bus.ctl_json("sdo-restore", INPUTS, str(file), "--yes")
    assert done["same"] == len(objects) - 1
    assert [(row["object"], row["slave"], row["result"]) for row in done["rows"]] == [
        ("0x8000:11", "0500", "written")
    ]
    assert bus.ctl_json("sdo-read", INPUTS, "0x8000", "0x11")["value"] == 0


def test_a_value_that_is_refused_does_not_stop_the_others(bus: Daemon, tmp_path: Path) -> None:
    file = tmp_path / "inputs.toml"
    bus.ctl("sdo-dump", INPUTS, "-o", str(file))
    head = file.read_text().split("[[startup]]")[0]
    rows = (
        ("0x1018:04", 7),  # read only
        ("0x8000:13", 7),
        ("0x7777:01", 7),  # not there
    )
    tables = "".join(
        f'[[startup]]\nobject = "{name}"\ntype = "int16"\nvalue = {value}\n' for name, value in rows
    )
    file.write_text(re.sub("values = .*", f"values = {len(rows)}", head) + tables)
    result = bus.ctl("sdo-restore", INPUTS, str(file), "--yes", "--json", check=False)
    assert result.returncode == 7
    found = {row["object"]: row["result"] for row in json.loads(result.stdout)["rows"]}
    assert found["0x8000:13"] == "written"
    names(found["0x7777:01"], "0x06020000")
    names(found["0x1018:04"], "0x06010002")
    bus.ctl("sdo-write", INPUTS, "0x8000", "0x13", "0")


def test_a_wrong_file_is_refused(bus: Daemon, tmp_path: Path) -> None:
    file = tmp_path / "axis.toml"
    bus.ctl("sdo-dump", AXIS, "-o", str(file))
    whole = bus.ctl("sdo-dump", INPUTS, "-o", "-").stdout
    wrong = bus.ctl("sdo-restore", INPUTS, str(file), "--yes", check=False)
    assert wrong.returncode == 2
    names(one_line_error(wrong.stderr, "ecatctl"), "another device", "slave 1 (EL3102)")
    for text, tokens in (
        ("startup = 5", ("[slave]",)),
        ('[slave]\nvendor = 2\nproduct = "x"', ("slave.product",)),
        ("[slave]\nvendor = 2\nproduct = 3\n[[startup]]\nvalue = 1", ("startup",)),
        ("[[", ("TOML",)),
        (whole[: whole.rindex("[[startup]]")], ("'values'",)),
        (whole.split("[[startup]]")[0], ("'values'",)),
    ):
        file.write_text(text)
        wrong = bus.ctl("sdo-restore", INPUTS, str(file), "--yes", check=False)
        assert wrong.returncode == 2, wrong.stderr
        names(one_line_error(wrong.stderr, "ecatctl"), file, *tokens)


def test_values_are_written_as_bytes_from_files_and_with_units(bus: Daemon, tmp_path: Path) -> None:
    where = (INPUTS, "0x8000", "0x11")
    before = bus.ctl("sdo-read", *where, "-o", str(tmp_path / "before")).stdout
    names(before, "2 bytes")
    bus.ctl("sdo-write", *where, "hex:07 00")
    assert bus.ctl_json("sdo-read", *where)["data"] == "0700"
    bus.ctl("sdo-write", *where, f"@{tmp_path / 'before'}")
    assert bus.ctl_json("sdo-read", *where)["data"] == (tmp_path / "before").read_bytes().hex()
    for text, status, tokens in (
        ("hex:0", 2, ("'hex:0'",)),
        (f"@{tmp_path}/missing", 2, (f"{tmp_path}/missing",)),
        ("5 m", 2, ("0x8000:11", "m")),
    ):
        wrong = bus.ctl("sdo-write", *where, text, check=False)
        assert wrong.returncode == status, wrong
        names(one_line_error(wrong.stderr, "ecatctl"), *tokens)


def test_negative_numbers_need_no_extra_syntax(bus: Daemon) -> None:
    """The slave itself says which of its objects are signed."""
    assert bus.ctl_json("sdo-read", INPUTS, "0x8000", "0x12")["type"] == "INTEGER32"
    for where, text, data, kind in (
        ("0x11", "-5", "fbff", "INTEGER16"),
        ("0x11", "-0x10", "f0ff", "INTEGER16"),
        ("0x12", "-2", "feffffff", "INTEGER32"),
        ("0x12", "0x10000", "00000100", "INTEGER32"),
        ("0x11", "0", "0000", "INTEGER16"),
    ):
        written = bus.ctl_json("sdo-write", INPUTS, "0x8000", where, text)
        assert (written["data"], written["type"]) == (data, kind)
        read = bus.ctl_json("sdo-read", INPUTS, "0x8000", where)
        assert (read["data"], read["type"], read["value"]) == (data, kind, int(text, 0))
    wrong = bus.ctl("sdo-write", INPUTS, "0x8000", "0x11", "-32769", check=False)
    assert wrong.returncode == 2
    names(one_line_error(wrong.stderr, "ecatctl"), "INTEGER16", "-32768", "32767")
