"""`ecatctl` against a live daemon: what it prints, and its exit statuses."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import (
    CYCLE_TIME_US,
    PYTHON,
    Daemon,
    names,
    naming,
    one_line_error,
    run_module,
    wait_for,
)
from ecatd.base.errors import EcatError, StateError

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]


def test_slaves_lists_the_rig(troll: Daemon) -> None:
    lines = troll.ctl("slaves").stdout.splitlines()
    assert lines[0].startswith("POS  ALIAS  IDENT  STATE  NAME  ")
    assert len([line for line in lines[1:] if line[:3].strip().isdigit()]) == 8
    assert lines[3].split()[:6] == ["2", "0", "0", "OP", "EL1018", "0x00000002"]
    document = troll.ctl_json("slaves")
    assert [slave["position"] for slave in document["slaves"]] == list(range(8))
    assert document["slaves"][4]["input_bytes"] == 32
    assert {(slave["domain"], slave["domain_name"]) for slave in document["slaves"]} == {(0, "")}
    assert len(document["fingerprint"]) == 16


def test_info_tells_the_time_on_the_wire(troll: Daemon) -> None:
    document = troll.ctl_json("info")
    # 17 bytes of outputs and 81 of inputs in one frame with the state of all slaves.
    assert (document["wire_frames"], document["wire_bytes"]) == (1, 40 + 14 + 12 + 98)
    # 80 ns a byte, and what the first slave has measured: 0.4 µs to each of the seven behind it
    # and 0.4 µs back. Its own microsecond is an estimate.
    assert document["wire_us"] == pytest.approx(164 * 0.08 + 7 * 0.8 + 1, abs=0.2)
    text = troll.ctl("info").stdout
    assert f"{document['wire_us']:g} µs in the longest cycle: 164 bytes, 1 frame" in text


def test_pdos_names_every_entry(troll: Daemon) -> None:
    text = troll.ctl("pdos", "0").stdout
    assert "0x6040:00  16 bit  UNSIGNED16  Control word" in text
    assert "EL1018" not in text
    assert "no process data" in troll.ctl("pdos", "1").stdout
    (slave,) = troll.ctl_json("pdos", "2")["slaves"]
    entries = [entry for pdo in slave["inputs"] for entry in pdo["entries"]]
    assert [entry["index"] for entry in entries] == [0x6000 + 16 * n for n in range(8)]


def test_state_shows_and_changes(troll: Daemon) -> None:
    wait_for(lambda: troll.ctl("state", check=False).stdout.count("OP") == 8, troll)
    assert troll.ctl("state", "3", "SAFEOP", "--yes").stdout.split()[-1] == "SAFEOP"
    rows = troll.slave_rows("state")
    assert [row["text"] for row in rows] == ["OP"] * 3 + ["SAFEOP"] + ["OP"] * 4
    troll.ctl("state", "op")
    assert {row["text"] for row in troll.slave_rows("state")} == {"OP"}
    wrong = troll.ctl("state", "RUN", check=False)
    assert wrong.returncode == 2
    names(one_line_error(wrong.stderr, "ecatctl"), "'RUN'", "INIT", "PREOP", "SAFEOP", "OP")


def test_state_goes_through_all_states_on_the_way_up(troll: Daemon) -> None:
    troll.ctl("state", "PREOP", "--yes")
    assert {row["text"] for row in troll.slave_rows("state")} == {"PREOP"}
    troll.ctl("state", "OP")
    assert {row["text"] for row in troll.slave_rows("state")} == {"OP"}
    refused = troll.ctl("state", "77", "PREOP", "--yes", check=False)
    assert refused.returncode == 7
    assert {row["text"] for row in troll.slave_rows("state")} == {"OP"}


def test_state_asks_before_slaves_leave_op(troll: Daemon) -> None:
    def refused(*arguments: str) -> str:
        found = troll.ctl("state", *arguments, check=False)
        assert found.returncode == 2
        return one_line_error(found.stderr, "ecatctl")

    names(refused("INIT"), f"8 slaves of bus '{troll.bus}'", "INIT", "outputs", "safe", "--yes")
    names(refused("EL2008", "SAFEOP"), "slave 3 (EL2008)", "SAFEOP", "outputs", "--yes")
    assert {row["text"] for row in troll.slave_rows("state")} == {"OP"}
    troll.ctl("state", "3", "PREOP", "--yes")
    troll.ctl("state", "3", "SAFEOP")  # it is not in OP, and goes up
    for position in range(4, 8):
        troll.ctl("state", str(position), "SAFEOP", "--yes")
    names(refused("SAFEOP"), "slave 0 (", "slave 1 (", "slave 2 (EL1018)", "their outputs")
    troll.ctl("state", "OP")


def test_sdo_in_every_kind(troll: Daemon) -> None:
    troll.ctl("sdo-write", "0", "0x6060", "0", "9")
    assert troll.ctl("sdo-read", "0", "0x6060").stdout == "0x09 9\n"
    assert troll.ctl("upload", "0", "0x6060", "0", "-v").stdout.split()[2:4] == [
        "0x6060:00",
        "INTEGER8",
    ]
    troll.ctl("download", "0", "0x6060", "0", "8", "--type", "sint")
    assert troll.ctl("sdo-read", "0", "0x6060").stdout == "0x08 8\n"
    document = troll.ctl_json("sdo-read", "0", "0x1018", "2")
    assert (document["value"], document["name"]) == (0x00030924, "Product code")
    text = troll.ctl("sdo-read", "4", "0x6000", "0x11", "-v").stdout
    found = re.fullmatch(r"0x[0-9A-F]{4} (-?\d+)  0x6000:11 INTEGER16 .* = (\S+) V\n", text)
    assert found, text
    document = troll.ctl_json("sdo-read", "4", "0x6000", "0x11")
    assert document["unit"] == "V"
    assert float(found[2]) == pytest.approx(int(found[1]) * document["scale"], rel=1e-4)
    assert troll.ctl("sdo-read", "4", "6000:11", "-v").stdout.split()[2] == "0x6000:11"
    troll.ctl("sdo-write", "0", "6060:00", "9")
    assert troll.ctl("sdo-read", "0", "0x6060").stdout == "0x09 9\n"
    assert "0x6041:00" in troll.ctl("sdo-read", "0", "status word", "-v").stdout
    for arguments in ("sdos 0 6060", "sdo-read 0 6060", "sdo-write 0 6060 0 1"):
        refused = troll.ctl(*arguments.split(), check=False)
        assert refused.returncode == 2
        names(refused.stderr, "0x6060", "0x17AC")
    # Longer than a mailbox or not, a name comes whole.
    assert "Gold" in troll.ctl("sdo-read", "0", "0x1008").stdout


@pytest.mark.parametrize(
    ("arguments", "status", "what"),
    [
        ("sdo-read 0 0x7777", 5, "SDO abort 0x06020000 | 0x7777:00 | `ecatctl sdos SLAVE`"),
        ("sdo-read 0 1018:63", 5, "SDO abort 0x06090011 | 0x1018:63"),
        ("sdo-read 0 Statuswort", 2, "slave 0 | 'Statuswort' | `ecatctl pdos 0`"),
        ("sdo-read 0 6060:00 1", 2, "0x6060:00 | subindex"),
        ("sdo-write 0 0x6060 1", 2, "0x6060:00 | subindex"),
        ("reg-read 0 130", 2, "0x0130 | 0x0082"),
        (
            "sdo-write 0 0x1018 1 5",
            5,
            "SDO abort 0x06010002 | 0x1018:01 | `ecatctl sdos SLAVE OBJECT`",
        ),
        ("sdo-read 9 0x1018", 7, "slave 9"),
        ("sdo-read 2 0x1018", 7, "slave 2 (EL1018) | object dictionary"),
        ("pdos 8", 7, "slave 8"),
        ("sdo-write 0 0x6060 0 900", 2, "900 | INTEGER8 | -128 | 127"),
        ("sdo-write 0 0x6060 0 x", 2, "'x' | INTEGER8"),
        ("sdo-write 0 0x6060 0 1 --type word3", 2, "'word3' | data type"),
        ("slaves --bus ../x", 2, "'../x' | name | bus"),
        ("doctor --bus=-x", 2, "'-x' | name | bus"),
        ("slaves --connect nonsense", 2, "nonsense | Zenoh"),
        ("slaves --connect tcp/127.0.0.1:1", 3, "no ecatd | answers"),
        ("slaves --bus nobody", 3, "not running | 'nobody' | running"),
    ],
)
def test_errors_say_what_and_why(troll: Daemon, arguments: str, status: int, what: str) -> None:
    result = troll.ctl(*arguments.split(), check=False)
    assert result.returncode == status, result.stderr
    names(one_line_error(result.stderr, "ecatctl"), *what.split(" | "))
    assert result.stdout == ""
    document = json.loads(troll.ctl(*arguments.split(), "--json", check=False).stdout)
    names(document["error"]["message"], *what.split(" | "))


@pytest.mark.parametrize(
    "arguments",
    [
        "",
        "nonsense",
        "sdo-read",
        "sdo-read 0",
        "sdo-read a/b 0x6060",
        "sdo-read 0 0x10000",
        "slaves x",
    ],
)
def test_wrong_usage_is_status_2(arguments: str) -> None:
    result = run_module("ecatd.cli", *arguments.split())
    assert result.returncode == 2
    assert "usage: ecatctl" in result.stderr


def test_every_document_names_its_bus(troll: Daemon, tmp_path: Path) -> None:
    for arguments in (
        *("slaves", "pdos", "state", "stats", "dc", "info"),
        *("sdo-read 0 0x6060", "sdo-write 0 0x6060 0 8", f"generate Named {tmp_path}"),
    ):
        assert troll.ctl_json(*arguments.split())["bus"] == troll.bus, arguments


def test_slaves_without_a_name_are_shown_as_such(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon(str(Path(__file__).parents[1] / "rigs" / "odd_names.py"))
    for command in ("slaves", "state"):
        assert daemon.ctl(command).stdout.splitlines()[3].count(" (no name) ") == 1
    with (
        daemon.client() as client,
        pytest.raises(
            StateError, match=naming("slave 2 (no name)", f"'{daemon.bus}'", "0x1234:00")
        ),
    ):
        client.signal(2, 0x1234)


@pytest.mark.parametrize("module", ["ecatd.service", "ecatd.cli"])
def test_every_exit_status_is_in_the_help(module: str) -> None:
    text = run_module(module, "--help").stdout
    listed = {
        int(code) for code in re.findall(r"(?<= )([0-9]+)(?= )", text.split("exit status")[1])
    }
    assert {error.exit_code for error in EcatError.__subclasses__()} <= listed


def test_options_may_stand_before_the_command(troll: Daemon) -> None:
    before = troll.ctl("--bus", troll.bus, "--json", "pdos")
    assert before.stdout == troll.ctl("pdos", "--json").stdout
    assert "flags" in json.loads(troll.ctl("--json", "client-flags").stdout)
    assert json.loads(troll.ctl("--bus", troll.bus, "--json", "info").stdout)["bus"] == troll.bus


@pytest.mark.parametrize("arguments", ["check {} --json", "check --json {}", "--json check {}"])
def test_options_may_stand_anywhere(tmp_path: Path, arguments: str) -> None:
    missing = str(tmp_path / "nothing.toml")
    told = run_module("ecatd.cli", "config", *arguments.format(missing).split())
    assert told.returncode == 2
    names(json.loads(told.stdout)["error"]["message"], missing)


@pytest.mark.parametrize("program", ["ecatd.service", "ecatd.cli", "ecatsim"])
def test_help_and_version(program: str) -> None:
    assert "usage:" in run_module(program, "--help").stdout
    assert run_module(program, "--version").stdout.split()[0] in ("ecatd", "ecatctl", "ecatsim")


@pytest.mark.parametrize(
    "command",
    [
        "slaves",
        "pdos",
        "state",
        "stats",
        "info",
        "sdo-read",
        "sdo-write",
        "generate",
        "library",
        "client-flags",
    ],
)
def test_every_command_explains_itself(command: str) -> None:
    text = run_module("ecatd.cli", command, "--help").stdout
    assert f"usage: ecatctl {command}" in text
    assert "--json" in text


def test_generate_writes_a_library_and_loses_nothing(troll: Daemon, tmp_path: Path) -> None:
    out = tmp_path / "out"
    first = troll.ctl("generate", "TrollPlant", str(out))
    assert "package.mo" in first.stdout
    assert (out / "TrollPlant" / "package.mo").is_file()
    assert (out / "EtherCAT" / "package.mo").is_file()
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    troll.ctl("generate", "TrollPlant", str(out))
    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before
    mine = out / "TrollPlant" / "Mine.mo"
    mine.write_text("within TrollPlant; model Mine end Mine;")
    order = out / "TrollPlant" / "package.order"
    assert troll.ctl("generate", "TrollPlant", str(out)).returncode == 0
    assert order.read_bytes() == before[order] + b"Mine\n"
    edited = out / "TrollPlant" / "EL1018.mo"
    edited.write_text(edited.read_text() + "\n")
    refused = troll.ctl("generate", "TrollPlant", str(out), check=False)
    assert refused.returncode == 7
    assert "EL1018.mo (changed)" in one_line_error(refused.stderr, "ecatctl")
    assert edited.read_bytes() == before[edited] + b"\n"
    forced = troll.ctl("generate", "TrollPlant", str(out), "--force")
    names(forced.stdout, "TrollPlant/EL1018.mo", "TrollPlant/EL1018.mo.orig")
    assert edited.read_bytes() == before[edited]
    assert edited.with_name("EL1018.mo.orig").read_bytes() == before[edited] + b"\n"
    assert mine.exists()


def test_check_tells_what_would_change(troll: Daemon, tmp_path: Path) -> None:
    out = str(tmp_path / "out")
    none = troll.ctl("generate", "Plant", out, "--check", check=False)
    assert none.returncode == 1
    assert "Plant would change: " in none.stdout
    assert not Path(out).exists()
    troll.ctl("generate", "Plant", out)
    same = troll.ctl("generate", "Plant", out, "--check")
    assert same.stdout == f"{out}/Plant: nothing would change\n"
    other = ("generate", "Plant", out, "--from", "line:2", "--check")
    text = troll.ctl(*other, check=False)
    assert text.returncode == 1
    gone = "slave 0 GoldGCONDrive: is gone (Gold EtherCAT GCON Drive, revision 0x00010420)"
    cycle = f"bus: cycle was {CYCLE_TIME_US} µs, is 1000 µs"
    assert text.stdout.splitlines()[:2] == [cycle, gone]
    data = troll.ctl(*other, "--json", check=False)
    assert data.returncode == 1
    document = json.loads(data.stdout)
    assert document["changed"] is True
    assert [each["text"] for each in document["differences"][:2]] == [cycle, gone]
    assert (document["differences"][1]["kind"], document["differences"][1]["slave"]) == ("gone", 0)
    assert troll.ctl("generate", "Plant", out, "--check").stdout == same.stdout


@pytest.mark.parametrize("name", ["Troll-Plant", "9Plant", "model", "EtherCAT", "Modelica", ""])
def test_generate_refuses_names_that_are_no_identifiers(
    troll: Daemon, tmp_path: Path, name: str
) -> None:
    result = troll.ctl("generate", name, str(tmp_path / "out"), check=False)
    assert result.returncode == 2
    assert not (tmp_path / "out").exists()


@pytest.mark.long
def test_names_that_are_no_identifiers_generate_all_the_same(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    from pymoca.parser import parse

    rig = Path(__file__).parents[1] / "rigs" / "odd_names.py"
    daemon = start_daemon(str(rig))
    daemon.ctl("generate", "Odd", str(tmp_path / "out"))
    files = sorted((tmp_path / "out" / "Odd").rglob("*.mo"))
    assert len(files) >= 8
    for file in files:
        assert parse(file.read_text()) is not None, file


@pytest.mark.parametrize("command", [["stats"], ["client-flags"]])
def test_an_output_that_cannot_be_written(troll: Daemon, command: list[str]) -> None:
    with Path("/dev/full").open("w") as full:
        result = subprocess.run(
            [sys.executable, "-m", "ecatd.cli", *command],
            env=troll.env,
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert result.returncode == 7
    assert result.stderr.count("\n") == 1
    names(one_line_error(result.stderr, "ecatctl"), "output", "No space left")


@pytest.mark.parametrize(
    "command",
    [
        "watch",
        "watch --json",
        "read --watch",
        "stats --watch --json",
        "claims --watch",
        "events --follow --since 1s",
        "errors --watch",
        "errors --watch --json",
        "capture --follow -o -",
    ],
)
def test_a_command_without_end_needs_its_stdout(troll: Daemon, command: str) -> None:
    shell = f"{PYTHON} -m ecatd.cli {command} >&-"
    done = subprocess.run(
        ["sh", "-c", shell], env=troll.env, stderr=subprocess.PIPE, text=True, check=False
    )
    assert done.returncode == 7
    names(one_line_error(done.stderr, "ecatctl"), "stdout")


def test_a_command_without_stderr_does_its_work(troll: Daemon) -> None:
    shell = f"{PYTHON} -m ecatd.cli sdo-dump 4 -o /dev/null 2>&-"
    assert subprocess.run(["sh", "-c", shell], env=troll.env, check=False).returncode == 0


def test_an_error_as_json_that_cannot_be_written_keeps_its_status(troll: Daemon) -> None:
    with Path("/dev/full").open("w") as full:
        result = subprocess.run(
            [sys.executable, "-m", "ecatd.cli", "sdo-read", "0", "0x5555", "--json"],
            env=troll.env,
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert result.returncode == 5
    names(one_line_error(result.stderr, "ecatctl"), "0x06020000")


def test_a_list_of_rigs_that_cannot_be_written() -> None:
    command = [sys.executable, "-m", "ecatsim", "rigs"]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == StateError.exit_code
    names(one_line_error(done.stderr, "ecatsim"), "output", "No space left")


@pytest.mark.parametrize("program", ["ecatd.service", "ecatd.cli", "ecatsim"])
def test_a_help_whose_reader_has_gone_ends_without_a_traceback(program: str) -> None:
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-m", program, "--help"]
    result = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, check=False)
    os.close(write)
    assert (result.returncode, result.stderr) == (0, b"")
    with Path("/dev/full").open("w") as full:
        result = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, check=False)
    assert result.returncode == StateError.exit_code
    assert result.stderr.count(b"\n") == 1
