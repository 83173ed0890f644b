"""What is printed cannot control the terminal, whatever prints it."""

import io
import json
import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

from conftest import names
from ecatd.base.log import Log
from ecatd.base.sanitized_output import (
    json_text,
    printable,
    sanitized_output,
    toml_string,
    xml_text,
)
from ecatd.cli.output import print_json_line, table_lines
from ecatd.cli.terminal import Screen, alarm, show
from ecatd.description import bus_file
from ecatdev import sample_buses

HOSTILE = "A\x1b]0;title\x07\x1b[31m\x9b2J\u202eB\rC\x00\ud800\x7f"
CLEAN = "A?]0;title??[31m?2J?B?C???"


def test_all_prints_of_a_command_are_plain(monkeypatch: pytest.MonkeyPatch) -> None:
    out, err = io.StringIO(), io.StringIO()
    monkeypatch.setattr(sys, "stdout", out)
    monkeypatch.setattr(sys, "stderr", err)
    with sanitized_output():
        print(HOSTILE, "µ│✓\t漢\u3000字", file=sys.stdout)
        sys.stderr.writelines([HOSTILE, "\n"])
        print("\n".join(table_lines(["name"], [[HOSTILE + "\n"]])))
        Log("ecatd").warning(f"{HOSTILE}\necatd: error: forged")
        show([HOSTILE])
        Screen().draw([HOSTILE])
    assert sys.stdout is out
    lines = out.getvalue().split("\n")
    assert lines == [f"{CLEAN} µ│✓\t漢 字", "name", f"{CLEAN}?", CLEAN, CLEAN, ""]
    assert err.getvalue() == f"{CLEAN}\necatd: warning: {CLEAN}\n  ecatd: error: forged\n"


def test_json_has_the_texts_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    out = io.StringIO()
    monkeypatch.setattr(sys, "stdout", out)
    with sanitized_output():
        print_json_line({"name": HOSTILE, "other": 'Größe "\\'})
    (line,) = out.getvalue().splitlines()
    assert line.isprintable()
    assert json.loads(line) == {"schema": 1, "name": HOSTILE, "other": 'Größe "\\'}
    assert "Größe" in line
    assert json.loads(json_text({"a": [HOSTILE]}, indent=2)) == {"a": [HOSTILE]}


def test_our_own_sequences_reach_a_terminal_and_those_of_others_do_not() -> None:
    program = (
        "from ecatd.base.sanitized_output import sanitized_output\n"
        "from ecatd.cli.terminal import Screen, alarm, show\n"
        "from ecatd.cli.output import progress\n"
        f"text = {HOSTILE[:5]!r} + 'x'\n"
        "with sanitized_output(), progress() as tell:\n"
        "    show([alarm(text)]); Screen().draw([text]); tell(text)\n"
    )
    ours, theirs = pty.openpty()
    subprocess.run(
        [sys.executable, "-c", program],
        check=True,
        stdout=theirs,
        stderr=theirs,
        env={**os.environ, "TERM": "xterm", "NO_COLOR": ""},
    )
    os.close(theirs)
    text = b""
    while True:
        try:
            text += os.read(ours, 4096)
        except OSError:  # all is read
            break
    os.close(ours)
    assert b"\x1b[31mA?]0;x\x1b[0m" in text
    assert b"\x1b[H" in text
    assert b"\x1b]0" not in text


@pytest.mark.parametrize("command", [("cstruct",), ("xml",), ("config", "init")])
def test_a_description_with_sequences(tmp_path: Path, command: tuple[str, ...]) -> None:
    bus = sample_buses.troll()
    for slave in bus.slaves:
        slave.name = HOSTILE.replace("\ud800", "")
        for pdo, entry, _ in slave.entries(outputs=False):
            pdo.name = entry.name = slave.name
    file = tmp_path / "evil.json"
    file.write_text(bus_file.dump(bus))
    done = subprocess.run(
        [sys.executable, "-m", "ecatd.cli", *command, "--from", str(file)],
        check=False,
        capture_output=True,
    )
    assert done.returncode == 0, done.stderr
    text = done.stdout.decode()
    assert "title" in text
    assert all(line.isprintable() for line in text.split("\n"))


def test_an_error_is_one_message(tmp_path: Path) -> None:
    file = tmp_path / "a\x1b[31m\necatctl: forged"
    done = subprocess.run(
        [sys.executable, "-m", "ecatd.cli", "cstruct", "--from", str(file)],
        check=False,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2
    first, second = done.stderr.splitlines()
    names(first, "ecatctl:", "a?[31m")
    assert second.startswith("  ecatctl: forged")


def test_quoting() -> None:
    assert printable(HOSTILE) == CLEAN
    assert xml_text('<a "b"> & \x1b') == "&lt;a &quot;b&quot;&gt; &amp; ?"
    assert toml_string('a"\\\x7f\U000e0001') == '"a\\"\\\\\\U0000007F\\U000E0001"'
    assert alarm("x") == "x"
