"""Ctrl-C in the first moments of a command."""

import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from ecatd.cli import main as cli
from ecatd.cli.commands import GROUPS, find_commands
from ecatd.service import main as service

COMMANDS = ("ecatd", "ecatctl", "ecatsim")

WHILE_LOADED = """
import importlib, os, signal, sys
load = importlib.import_module

def interrupted(name):
    os.kill(os.getpid(), signal.SIGINT)
    return load(name)

importlib.import_module = interrupted
from ecatd import commands
sys.argv = [{0!r}, "--version"]
sys.exit(commands.{0}())
"""


@pytest.mark.parametrize("command", COMMANDS)
def test_ctrl_c_while_a_command_is_loaded_ends_it_quietly(command: str) -> None:
    result = subprocess.run(
        [sys.executable, "-c", WHILE_LOADED.format(command)], capture_output=True, text=True
    )
    assert (result.returncode, result.stdout, result.stderr) == (-2, "", "")


def test_where_it_is_ignored_it_stays_so() -> None:
    """As in a job that a script runs in the background."""
    code = "import signal; signal.signal(2, signal.SIG_IGN)\n" + WHILE_LOADED.format("ecatctl")
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith("ecatctl ")


def test_ctrl_c_before_the_work_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted() -> None:
        raise KeyboardInterrupt

    for module, status in ((cli, 130), (service, 0)):
        monkeypatch.setattr(module, "make_parser", interrupted)
        assert module.main() == status


SLOW = (
    "asyncio",
    "inspect",
    "importlib.metadata",
    "ecatd.shm.contract",
    "ecatd.description.bus",
    "ecatd.shm.statistics",
)


@pytest.mark.parametrize("module", ["ecatd.cli.sdo", "ecatd.client.remote"])
def test_an_sdo_command_loads_nothing_that_it_does_not_need(module: str) -> None:
    """Else most of its time goes into that."""
    code = f"import sys, ecatd.cli.main, {module}; print(*({set(SLOW)} & sys.modules.keys()))"
    result = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
    )
    assert result.stdout == "\n"


WITHOUT_RIGHTS = ["unshare", "--user", "--map-user=1000"]
"""In a user namespace, this process has no rights of root."""


def test_folders_that_may_not_be_looked_at(tmp_path: Path) -> None:
    closed = tmp_path / "closed"
    closed.mkdir(mode=0)
    program = f"""
from importlib import import_module
from pathlib import Path
from ecatd.shm import files
files.folders = lambda: [Path({str(closed)!r})]
print(files.exists("ecat0"))
"""
    command = [*WITHOUT_RIGHTS, sys.executable, "-c", program]
    assert subprocess.check_output(command, text=True) == "False\n"
    # What nobody has thought of is told with the name of the file, and not as something else.
    command = [*WITHOUT_RIGHTS, sys.executable, "-m", "ecatd.cli", "--connect", "tls/localhost:1"]
    done = subprocess.run(
        [*command, "info"],
        env={**os.environ, "XDG_CONFIG_HOME": str(closed)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 7
    assert done.stderr.startswith(f"ecatctl: {closed}")
    assert "Permission denied" in done.stderr


def test_a_screen_that_says_so_is_a_command() -> None:
    """The tables are read without importing the screens, and are what these have."""
    by_screen: dict[str, dict[str, dict[str, str]]] = {}
    for one in find_commands():
        groups = by_screen.setdefault(one.module, {})
        groups.setdefault(one.group, {})[one.name] = one.summary
    for path in Path(cli.__file__).parent.glob("[a-z]*.py"):
        screen = vars(import_module(f"ecatd.cli.{path.stem}"))
        assert screen.get("COMMANDS", {}) == by_screen.get(path.stem, {})
        assert "COMMANDS" in screen or "add_arguments" not in screen
    names = [one.name for one in find_commands()]
    assert len(set(names)) == len(names) > 50
    assert {one.group for one in find_commands()} == set(GROUPS)


def test_commands_are_found_without_loading_screens() -> None:
    code = "import sys, ecatd.cli.main as m; m.make_parser(); print(*sys.modules)"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name for name in found.stdout.split() if name.startswith("ecatd.cli.")}
    assert loaded == {"ecatd.cli.main", "ecatd.cli.commands", "ecatd.cli.arguments"}


@pytest.mark.parametrize(
    ("command", "line", "meant"),
    [
        ("ecatctl", ["slavs"], "slaves"),
        ("ecatctl", ["config", "chek", "file.toml"], "check"),
        ("ecatsim", ["devises"], "devices"),
        ("ecatsim", ["ctl", "power_off"], "power-off"),
        ("ecatsim", ["check", "trol"], "troll"),
    ],
)
def test_a_wrong_name_has_the_close_one_in_its_message(
    command: str, line: list[str], meant: str
) -> None:
    code = f"import sys; from ecatd import commands; sys.exit(commands.{command}())"
    done = subprocess.run([sys.executable, "-c", code, *line], capture_output=True, text=True)
    assert done.returncode == 2
    assert f"did you mean '{meant}'?" in done.stderr


def test_without_a_close_name_the_message_says_where_all_are() -> None:
    code = "import sys; from ecatd import commands; sys.exit(commands.ecatctl())"
    done = subprocess.run([sys.executable, "-c", code, "xyz"], capture_output=True, text=True)
    assert done.returncode == 2
    assert "`ecatctl --help`" in done.stderr
    assert "did you mean" not in done.stderr
