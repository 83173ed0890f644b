"""The examples of the documentation, run as they stand."""

import re
import sys
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, cast, get_args, get_origin, get_type_hints

import pytest

from conftest import Daemon, names, run_module
from ecatd.model.config import (
    Config,
    CopyConfig,
    DomainConfig,
    SignalConfig,
    SlaveConfig,
    load_config,
    read_config,
)
from ecatd.model.errors import ConfigError, EcatError

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

ROOT = Path(__file__).parents[2]


def blocks(document: str, language: str) -> list[str]:
    text = (ROOT / document).read_text()
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def anchors(document: Path) -> set[str]:
    """What links may name behind a #: headings in small letters, with hyphens for spaces."""
    text = re.sub(r"^```.*?^```", "", document.read_text(), flags=re.MULTILINE | re.DOTALL)
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading).lower().replace(" ", "-") for heading in headings}


def test_every_error_has_an_entry() -> None:
    def family(kind: type[EcatError]) -> Iterator[type[EcatError]]:
        yield kind
        for child in kind.__subclasses__():
            yield from family(child)

    text = (ROOT / "docs/troubleshooting.md").read_text().split("## Errors by name")[1]
    told = dict(re.findall(r"^\| `(\w+)` \| (\d+) \|", text, re.MULTILINE))
    ours = [kind for kind in family(EcatError) if kind.__module__ == EcatError.__module__]
    assert told == {kind.name: str(kind.exit_code) for kind in ours}


def test_every_link_leads_somewhere() -> None:
    for document in (*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")):
        for target, anchor in re.findall(r"\]\(([^)#]*)#?([^)]*)\)", document.read_text()):
            if "://" not in target:
                page = document.parent / target if target else document
                assert page.exists(), f"{document.name}: {target}"
                assert not anchor or anchor in anchors(page), f"{document.name}: {target}#{anchor}"


def configuration_keys(table: type, above: str = "") -> Iterator[str]:
    """Keys as the documentation writes them: `dc.enabled`, and `[[dc.slave]]` for an array."""
    hints = get_type_hints(table)
    for item in fields(table):
        if not item.compare:  # where the table is written
            continue
        kind = hints[item.name]
        inner = next((arg for arg in (kind, *get_args(kind)) if is_dataclass(arg)), None)
        name = above + item.name
        if inner is None or inner is not kind:
            table_name = f"`[[{name}]]`" if get_origin(kind) is list else f"`[{name}]`"
            yield f"`{name}`" if inner is None else table_name
        if inner is not None:
            yield from configuration_keys(cast("type", inner), name + ".")


def test_every_configuration_key_is_documented(tmp_path: Path) -> None:
    text = (ROOT / "docs/configuration.md").read_text()
    keys = list(configuration_keys(Config))
    assert {"`bus`", "`dc.lock_us`", "`[[dc.slave]]`", "`dc.slave.sync0_us`"} <= set(keys)
    assert [key for key in keys if key not in text] == []
    example = (ROOT / "systemd/ecat0.toml").read_text()
    load_config(ROOT / "systemd/ecat0.toml")
    commented = tmp_path / "all.toml"
    commented.write_text(re.sub(r"^# (?=\[\[|\w+ = )", "", example, flags=re.MULTILINE))
    config = load_config(commented)
    assert (len(config.outputs.safe), len(config.domain), len(config.dc.slave)) == (2, 2, 1)


def test_the_readme_commands(start_daemon: Callable[..., Daemon], tmp_path: Path) -> None:
    daemon = start_daemon("troll")
    commands = [
        line.split("#")[0].split()[1:]
        for block in blocks("README.md", "sh")
        for line in block.splitlines()
        if line.startswith("ecatctl ")
    ]
    assert len(commands) == 3
    for command in commands:
        command = [str(tmp_path / part) if part == "models" else part for part in command]
        daemon.ctl(*command)


def test_the_rig_and_device_files(tmp_path: Path) -> None:
    for block in blocks("docs/simulator-rigs.md", "toml"):
        name = re.match(r"# (\w+\.toml)$", block, re.MULTILINE)
        if name:
            (tmp_path / name[1]).write_text(block)
    rig = tmp_path / "press.toml"
    checked = run_module("ecatsim", "check", str(rig))
    assert (checked.returncode, checked.stderr) == (0, "")
    assert re.search(r"2 0000ffff:00000020:00000000 +1 +4 +1:1 +Valve\n$", checked.stdout)
    master = (
        "import sys, time, pysoem; m = pysoem.Master(); m.open('ecat-master'); m.config_init(); "
        "m.config_map(); [s.set_watchdog('processdata', 3000) for s in m.slaves]; "
        "valve = m.slaves[2]; m.state_check(4, 2_000_000); m.state = 8; "
        "m.send_processdata(); m.write_state(); "
        "wait = lambda: (m.send_processdata(), m.receive_processdata(10_000), time.sleep(0.001)); "
        # Ends with the first OP: without process data the watchdog would take the slaves out of it.
        "any(m.state_check(8, 1000) == 8 or not wait() for _ in range(2000)); "
        "m.slaves[1].output = valve.output = b'\\x01'; [wait() for _ in range(100)]; "
        "pressure = int.from_bytes(valve.input[2:], 'little'); "
        "print(valve.input[0], 4000 <= pressure <= 8000, valve.sdo_read(0x8000, 0).hex()); "
        "m.state = 1; m.write_state(); m.close()"
    )
    result = run_module("ecatsim", "run", str(rig), "--", sys.executable, "-c", master)
    assert (result.returncode, result.stdout) == (0, "3 True fa00\n"), result.stderr


@pytest.mark.long
def test_the_page_about_commissioning(
    start_daemon: Callable[..., Daemon], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its commands, in order, on its machine; the configuration with its tables is valid there."""
    rig, tables = blocks("docs/commissioning.md", "toml")
    machine = tmp_path / "machine.toml"
    machine.write_text(rig)
    daemon = start_daemon(str(machine))
    monkeypatch.chdir(tmp_path)
    commands = "".join(blocks("docs/commissioning.md", "sh")).splitlines()
    assert len(commands) == 7
    for command in commands:
        program, *arguments = command.split()
        module = {"ecatctl": "ecatd.cli", "ecatd": "ecatd.service"}[program]
        result = run_module(module, *arguments, env=daemon.env)
        assert result.returncode == 0, (command, result.stderr)
    written = (tmp_path / "ecat0.toml").read_text()
    assert (tmp_path / "models" / "Machine" / "package.mo").exists()
    assert daemon.stop() == 0
    begin = written.index("[[slave]]\nposition = 4")
    own = written[:begin] + tables + written[written.index("[dc]") :]
    again = start_daemon(str(machine), config=own)
    assert again.ctl_json("sdo-read", "axis", "0x6065")["value"] == 50000
    names(again.ctl("pdos", "-p", "EL3008").stdout, "pressure", "bar")


ARRAYS_OF_TABLES = (
    "copy",
    "domain",
    "dc.slave",
    "outputs.safe",
    "signal",
    "slave",
    "slave.pdo",
    "slave.pdo.entries",
    "slave.startup",
)
DEPENDENT = ("domain.phase", "dc.phase_us", "dc.lock_us")
"""Keys whose largest value follows from others, which the documentation says in words."""


def one_key(key: str, value: str) -> dict[str, Any]:
    """A configuration with nothing but this key."""
    table, _, name = key.rpartition(".")
    parts = table.split(".")
    above = [".".join(parts[:end]) for end in range(1, len(parts))]
    head = "".join(f"[[{name}]]\n" for name in above if name in ARRAYS_OF_TABLES)
    head += f"[[{table}]]" if table in ARRAYS_OF_TABLES else f"[{table}]"
    return tomllib.loads(f"{head if table else ''}\n{name} = {value}")


def test_defaults_and_ranges_are_documented() -> None:
    """They are those of the program, as a number far too large makes it say."""
    text = (ROOT / "docs/configuration.md").read_text()
    rows = re.findall(r"^\| `([a-z0-9_.]+)` \|(.*?)\|(.*?)\|", text, re.MULTILINE)
    assert len(rows) > 30
    numbers = 0
    for key, default, limits in rows:
        with pytest.raises(ConfigError) as caught:
            read_config(one_key(key, "10_000_000_000"))
        if bounds := re.search(r"must be from (\S+) to (\S+)$", str(caught.value)):
            numbers += 1
            said = re.sub(r"(?<=\d) (?=\d)", "", limits)
            words = said.split()
            assert bounds[1] in words or key.endswith("sync0_us"), (key, limits)
            assert bounds[2] in words or key in DEPENDENT, (key, limits)
        if default.strip().startswith("`") and "." not in key:
            (value,) = one_key(key, default.strip(" `")).values()
            assert value == getattr(Config(), key), key
        elif default.strip().startswith("`") and key.count(".") == 1:
            table, name = key.split(".")
            rows_of = {
                "copy": CopyConfig(0, "0x7000:01", 0, "0x6000:01"),
                "domain": DomainConfig(),
                "signal": SignalConfig(0, "0x6041:00"),
                "slave": SlaveConfig(0),
            }
            made = rows_of.get(table) or getattr(Config(), table)
            (written,) = one_key(key, default.strip(" `")).values()
            known = made[name] if isinstance(made, dict) else getattr(made, name)
            assert (written[0] if table in rows_of else written)[name] == known, key
    assert numbers > 15
