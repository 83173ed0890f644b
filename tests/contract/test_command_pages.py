"""Man pages and completion are those of today's parsers, and the programs that read them do."""

import shlex
import shutil
import subprocess
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
