"""What holds for each command of `ecatctl`: it asks before it does harm, and prints JSON."""

import argparse
import inspect
import json
import re
import shlex
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import pytest

from conftest import Daemon
from ecatd.cli.commands import find_commands
from ecatd.operations.catalog import OPERATIONS
from ecatd.operations.operation import needs_right

MODULES = {found.name: found.module for found in find_commands()}
RIGS = Path(__file__).parents[1] / "rigs"

# --- questions -----------------------------------------------------------------------------------

ASK = """
    write drive state sdo-restore diagnosis sii-write alias foe-read foe-write reboot reg-write
    service
"""
"""Commands that ask before they do harm. Those that are not here and not below change nothing."""

TYPED = "it changes exactly what the user has typed, of one slave"
FILES = "it writes files for the user, and nothing to a slave"
DO_NOT_ASK = {
    "sdo-write": TYPED,
    "soe-write": TYPED,
    "eoe-write": TYPED,
    "errors": "--reset clears counters that nothing but their readers depends on",
    "log-level": "it holds until the next start, and the bus does not depend on it",
    "identify": "a LED flickers for some seconds",
    "doctor": "--fix changes only what --undo changes back",
    "record": FILES,
    "sdo-dump": FILES,
    "config": FILES,
    "startup": FILES,
    "generate": FILES,
    "library": FILES,
    "capture": FILES,
    "incident": "it deletes only a recording that its user has named",
    "remote": FILES,
}


def test_each_command_that_changes_something_asks_or_has_a_reason() -> None:
    change = {*ASK.split(), *DO_NOT_ASK}
    assert change <= set(MODULES)
    screens = {MODULES[name] for name in change}
    for name, module in MODULES.items():
        screen = import_module(f"ecatd.cli.{module}")
        parser = argparse.ArgumentParser()
        getattr(screen, "add_arguments", lambda *_: None)(parser, name)
        assert ("--yes" in parser.format_usage()) == (name in ASK.split()), name
        source = inspect.getsource(screen)
        asked = {kind.__name__ for kind in OPERATIONS.values() if needs_right(kind)}
        found = asked & set(re.findall(r"\w+", source))
        assert module in screens or not found, f"{name} needs a reason not to ask: {found}"


# --- JSON ----------------------------------------------------------------------------------------

NO_DOCUMENT = {
    "top": "it is a screen for people, and says so",
    "metrics": "OpenMetrics is a format for programs; `stats --json` has the same",
    "web": "it serves pages until it is ended; `test_web.py` reads what it prints",
    "log": "it prints lines without end; `test_log_levels.py` reads them",
}

FILES_RIG = """
buses; slaves; graph; pdos; read; watch --count 1; state; check; stats; claims; shm; dc; info
can stats; drive 0 status
write '0/0x6040:00=0' --for 0.1 --yes
record -o record.csv --for 0.1
sdos 0 0x1018; sdo-read 0 0x1018 1; sdo-write 0 0x6060 0 8
sdo-dump 0 -o values.toml; sdo-restore 0 values.toml --yes
diagnosis 0; waiting; events; errors
sii-read 0 -o sii.bin; sii-write 0 sii.bin --yes; alias 0 7 --yes
foe-read 0 parameters.bin -o parameters.bin; foe-write 0 parameters.bin --yes
soe-read 1 S-0-0001; soe-write 1 S-0-0001 2000
rescan; reboot 2 --yes; identify 0 --seconds 0.1
reg-read 0 al_status; reg-write 0 0x0410 1000 --yes
log-level; config show; config init; startup verify; startup capture 0
scan; cstruct; xml; generate Plant library; library other; client-flags
capture -o last.pcapng; incident list
doctor; service install --root . --dry-run; remote init --dir tls
"""
ETHERNET_RIG = "eoe; eoe-read 1; eoe-write 1 --address 192.168.7.2/24"


def lines(text: str) -> list[str]:
    return [line.strip() for line in text.replace(";", "\n").splitlines() if line.strip()]


@pytest.mark.bus
@pytest.mark.long
def test_each_command_prints_json(
    start_daemon: Callable[..., Daemon], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    named = {line.split()[0] for line in lines(FILES_RIG) + lines(ETHERNET_RIG)}
    assert named <= set(MODULES)
    others = sorted(set(MODULES) - named - set(NO_DOCUMENT))  # they need no arguments
    wrong = []
    for rig, text in (("files", [*lines(FILES_RIG), *others]), ("ethernet", lines(ETHERNET_RIG))):
        daemon = start_daemon(str(RIGS / f"{rig}.py"))
        for line in text:
            found = daemon.ctl(*shlex.split(line), "--json", check=False)
            document = json.loads(found.stdout or "{}")
            if document.get("schema") != 1 or "error" in document:
                wrong.append((line, found))
    assert not wrong
