"""Man pages and completion are those of today's parsers, and the programs that read them do."""

import shlex
import shutil
import subprocess
import sysconfig
from pathlib import Path

import pytest

from ecatdev.command_pages import pages

SHARE = Path(__file__).parents[2] / "share"
COMMAND = "PYTHONPATH=tools .venv/bin/python -m ecatdev.command_pages share"


def test_they_are_up_to_date() -> None:
    wanted = {path: text.rstrip("\n") + "\n" for path, text in pages().items()}
    files = (path for path in SHARE.rglob("*") if path.is_file())
    found = {str(path.relative_to(SHARE)): path.read_text() for path in files}
    assert sorted(found) == sorted(wanted), f"run: {COMMAND}"
    for path, text in wanted.items():
        assert found[path] == text, f"{path} is out of date; run: {COMMAND}"


@pytest.mark.parametrize("name", ["ecatd", "ecatctl", "ecatsim"])
def test_a_page_begins_as_whatis_wants_it_and_names_every_command(name: str) -> None:
    text = (SHARE / f"man/man1/{name}.1").read_text()
    assert f"\n.SH NAME\n{name} \\- " in text
    program = Path(sysconfig.get_path("scripts")) / name
    told = subprocess.run([program, "--help"], capture_output=True, text=True, check=True).stdout
    for line in told.splitlines():
        if line.startswith("    ") and not line.startswith("     "):
            assert line.split()[0].replace("-", "\\-") in text, line


def test_the_page_says_what_each_action_does() -> None:
    text = (SHARE / "man/man1/ecatctl.1").read_text().replace("\\-", "-")
    for command, actions in {
        "service": ("install", "upgrade", "uninstall"),
        "config": ("init", "from-eni", "check", "diff", "show"),
        "startup": ("verify", "capture"),
    }.items():
        notes = text.partition(f".SH NOTES \\fI\\,'ecatctl {command}'")[2].partition("\n.SH ")[0]
        said = [line.split()[0] for line in notes.splitlines() if line.startswith("  ")]
        assert set(actions) <= set(said), notes


def complete(text: str) -> set[str]:
    """What bash offers for a line that has been typed so far."""
    script = f"""
        source {shlex.quote(str(SHARE / "bash-completion/completions/ecatctl"))}
        COMP_WORDS=({text} '') COMP_CWORD={len(text.split())} COMP_LINE='{text} '
        COMP_POINT={len(text) + 1}
        function_=$(complete -p ecatctl | sed 's/.*-F \\([^ ]*\\).*/\\1/')
        "$function_" ecatctl '' {text.split()[-1]}
        printf '%s\\n' "${{COMPREPLY[@]}}"
    """
    shell = ["bash", "-c", script]
    return set(subprocess.run(shell, capture_output=True, text=True, check=True).stdout.split())


def test_bash_completes_commands_and_their_choices() -> None:
    assert {"slaves", "sdo-read", "generate", "service"} <= complete("ecatctl")
    assert {"init", "check", "diff"} <= complete("ecatctl config")
    assert {"install", "uninstall", "upgrade"} <= complete("ecatctl service")


@pytest.mark.parametrize(
    ("shell", "file"),
    [("zsh", "zsh/site-functions/_ecatctl"), ("fish", "fish/vendor_completions.d/ecatctl.fish")],
)
def test_other_shells_can_read_it(shell: str, file: str) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"there is no {shell}")
    subprocess.run([shell, "-n", SHARE / file], check=True)
