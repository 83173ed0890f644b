"""Dangerous commands ask, and do nothing unless the answer is yes."""

import argparse
import os
import pty
import select
import sys

import pytest

from ecatd.base.errors import UsageError
from ecatd.cli.arguments import add_yes, confirm

ABOUT = "The EEPROM of slave 3 (EL1008) gets a new alias, 5."


def _options(*given: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_yes(parser)
    return parser.parse_args(given)


def test_yes_asks_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    confirm(_options("--yes"), ABOUT)
    assert capsys.readouterr() == ("", "")


def test_without_a_terminal_it_refuses() -> None:
    with pytest.raises(UsageError, match=r"slave 3 .* --yes"):
        confirm(_options(), ABOUT)


@pytest.mark.parametrize(
    ("typed", "goes_on"),
    [("y\n", True), ("Yes\n", True), ("\n", False), ("n\n", False), ("\x04", False)],
)
def test_on_a_terminal_it_asks(typed: str, goes_on: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    master, terminal = pty.openpty()
    with os.fdopen(terminal, "r+b", buffering=0) as raw, os.fdopen(os.dup(raw.fileno())) as stdin:
        stderr = os.fdopen(os.dup(raw.fileno()), "w")
        monkeypatch.setattr(sys, "stdin", stdin)
        monkeypatch.setattr(sys, "stderr", stderr)
        os.write(master, typed.encode())
        if goes_on:
            confirm(_options(), ABOUT)
        else:
            with pytest.raises(UsageError, match="nothing was done"):
                confirm(_options(), ABOUT)
        stderr.close()
        shown = b""
        while (
            ABOUT.encode() not in shown
        ):  # a terminal gives its echo and the question in any number of pieces
            assert select.select([master], [], [], 60)[0], f"the question was not asked: {shown!r}"
            shown += os.read(master, 4096)
    os.close(master)
