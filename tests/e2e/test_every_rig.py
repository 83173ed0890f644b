"""Each command of `ecatctl` with each kind of bus: an answer or one sentence, never a traceback."""

import shlex
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import Daemon
from ecatd.cli.commands import find_commands
from ecatd.cli.main import main

pytestmark = [pytest.mark.bus, pytest.mark.long]

RIGS = {
    "none": "",
    "coupler only": "terminals:1",
    "inputs only": '[[slave]]\ndevice = "EL1008"\n',
    "without a mailbox": "line:2",
    "SoE": str(Path(__file__).parents[1] / "rigs" / "files.py"),
    "300 slaves": "terminals:300",
}
COMMANDS = """
buses; slaves; graph; pdos; pdos 0; read; read 'x/*'; read --watch 0.05 --count 2
watch --count 1; watch '*/x' --count 1
record -o record.csv --for 0.05; record -o record.mcap --for 0.05; write 0/x=1 --for 0.05 --yes
state; state 0; state 0 OP --yes; check; stats; metrics; claims; claims 0; shm; shm --raw slots; dc
info; sdos 0; sdo-read 0 0x1018 1; sdo-read 0 1018:01; sdo-read 0 nothing; sdo-write 0 1018:01 1
sdo-dump 0 -o values.toml; sdo-restore 0 values.toml --yes; diagnosis 0
events; events 0; errors; errors 0
sii-read 0; sii-write 0 nothing.bin --yes; alias 0 0 --yes
foe-read 0 x -o x.bin; foe-write 0 x.bin --yes
soe-read 0; soe-read 0 S-0-0001; soe-write 0 S-0-0001 1; eoe; eoe-read 0; eoe-write 0 --name x
rescan; reboot 999 --yes; identify 0 --seconds 0.05; reg-read 0; reg-read 0 130
reg-write 0 0x0410 1000 --yes
log-level; config show; config init; config check ecat0.toml; config diff ecat0.toml
startup verify; startup capture 0; scan -o bus.json; cstruct; xml
generate Plant library; generate Plant library --check; generate Plant library --fmu
library other; client-flags
capture -o frames.pcapng; capture -o more.pcapng --follow --duration 0.05; doctor
"""
ELSEWHERE = {
    "log": "it prints lines until it is ended",
    "remote": "it needs no bus",
    "service": "it needs no bus",
}


def lines(text: str) -> list[str]:
    return [line.strip() for line in text.replace(";", "\n").splitlines() if line.strip()]


def all_lines() -> list[str]:
    """Those above, and all other commands without arguments."""
    given = lines(COMMANDS)
    names = {found.name for found in find_commands()}
    others = names - {*ELSEWHERE} - {line.split()[0] for line in given}
    return [*given, *sorted(others)]


@pytest.mark.parametrize("kind", RIGS)
def test_no_command_ends_with_a_traceback(
    kind: str,
    start_daemon: Callable[..., Daemon],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    rig = RIGS[kind]
    if "\n" in rig:
        Path("rig.toml").write_text(rig)
        rig = "rig.toml"
    environment = {"ECATD_BUS": "nobody", "ECATD_RUNTIME_DIR": str(tmp_path)}
    if rig:
        environment = start_daemon(rig).env
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    Path("ecat0.toml").write_text("[[slave]]\nposition = 0\n")
    wrong = []
    for line in all_lines():
        for more in ((), ("--json",)) if kind == "coupler only" else ((),):
            monkeypatch.setattr(sys, "argv", ["ecatctl", *shlex.split(line), *more])
            try:
                status = main()
            except SystemExit as end:  # wrong usage
                status = end.code
            said = capfd.readouterr()
            if status not in range(8) or "Traceback" in said.out + said.err:
                wrong.append((line, status, said.err[-300:]))
    assert not wrong
