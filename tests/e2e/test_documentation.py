"""The examples of the documentation, run as they stand."""

import contextlib
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import rumoca

import ecatdev.checks
from conftest import Daemon, names, run_module, wait_for
from ecatd.base.errors import EcatError
from ecatd.config import load_config

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


def test_the_example_configuration(tmp_path: Path) -> None:
    """It is valid, also with what is commented out."""
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
        "m.slaves[1].output = valve.output = b'\\x01'; "
        "any(valve.input[0] == 3 or not wait() for _ in range(2000)); "
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
    names(again.ctl("pdos", "EL3008").stdout, "pressure", "bar")


def test_the_page_about_a_fault_of_yesterday(
    start_daemon: Callable[..., Daemon], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its commands, in order: the fault, the record, the mended model, and the machine again."""
    pytest.importorskip("mcap")
    page = "docs/yesterday.md"
    (settings,) = blocks(page, "toml")
    (model,) = blocks(page, "modelica")
    folder = tmp_path / "incidents"
    config = settings.replace("/tmp/incidents", str(folder))
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    commands = [line.split() for block in blocks(page, "sh") for line in block.splitlines()]
    modules = {"ecatctl": "ecatd.cli", "ecatsim": "ecatsim"}
    with contextlib.ExitStack() as stack:
        daemon, old, said = None, None, []
        for program, *arguments in commands:
            if program == "ecatd":
                if daemon is not None:
                    assert daemon.stop() == 0
                simulate, rig, option, file = arguments
                assert simulate == "--simulate"
                daemon = (
                    start_daemon(rig, config=config)
                    if option == "--config"
                    else start_daemon(rig, option, file)
                )
                continue
            assert daemon is not None
            env = {**daemon.env, "ECATSIM_NAME": str(daemon.child_pid("ecatsim"))}
            if program == "python" and old is None:  # it runs beside the others
                old = stack.enter_context(
                    subprocess.Popen(
                        [sys.executable, *arguments], env=env, stdout=subprocess.PIPE, text=True
                    )
                )
                stack.callback(old.kill)
                wait_for(lambda: "owns outputs" in daemon.ctl("events").stdout, daemon)  # noqa: B023
                continue
            if program == "python":
                done = subprocess.run(
                    [sys.executable, *arguments],
                    env=env,
                    capture_output=True,
                    text=True,
                    check=False,
                )
                said.append(done.stdout)
            else:
                if program == "ecatsim":  # as long as a person needs: the start is not recorded
                    wait_for(lambda: daemon.ctl_json("stats")["cycles"] > 400, daemon)  # noqa: B023
                done = run_module(modules[program], *arguments, env=env)
            assert done.returncode == 0, (program, arguments, done.stderr)
            if program == "ecatsim":
                wait_for(lambda: any(folder.glob("*.mcap")), daemon)
            if arguments[:2] == ["incident", "show"]:
                names(
                    done.stdout,
                    "3/Channel 1/Output was 1, above 0.5",
                    "changed from 1.00009 V to -8.15546 V",
                )
                assert old is not None
                old.kill()
                names(old.communicate()[0], "pump on at -8.16 V")
    against, mended, again, mended_again = said
    for mistaken in (against, again):
        names(mistaken, "pump on at -8.16 V", "switched on 1 times")
    assert mended == mended_again == "the pump has not run\n"
    (tmp_path / "TankControl.mo").write_text(f"within ;\n{model}")
    stand_in = Path(ecatdev.checks.__file__).parent / "Modelica"
    library = tmp_path / "library"
    library.mkdir()
    for name in ("Tank.mo", "Tank.txt", "TankControl.mo"):
        (tmp_path / name).rename(library / name)
    shutil.copytree(stand_in, library / "Modelica")
    rumoca.Session(roots=[str(library)]).load(str(library / "TankControl.mo"), model="TankControl")
