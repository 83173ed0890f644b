"""Each message about a time-out says what was waited for, how long, and what changes it.

`Timeout` is how long, with the key, option or argument that changes it. The sources are searched
for messages that are raised, or returned as errors, because a time has passed.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from conftest import names
from ecatd.base.errors import ConfigError
from ecatd.base.timeouts import Timeout
from ecatd.config import Config, load_config
from ecatd.etg.al import AlState
from ecatd.master.al_states import SlaveState, why_not_reached
from ecatd.master.mailbox.mailbox_queue import MailboxQueue

ROOT = Path(__file__).parents[2]
SOURCES = [
    file
    for folder in ("daemon/ecatd", "simulator/ecatsim", "codegen/ecatgen")
    for file in sorted((ROOT / folder).rglob("*.py"))
]
PASSED = re.compile(r"deadline|monotonic\(\)|ETIMEOUT|_until\b|waited >|now >")
"""In the condition of an `if`: a time has passed."""
SAYS = re.compile(
    r"patience|Timeout\(|_LIMIT\b|_CARRIER|_REPEAT|FIRST_ANSWER|_ABANDONED|\.whole\b", re.IGNORECASE
)
"""In a message: how long."""
OTHERS = {
    # They say it by a method whose message has it, or pass on an error that does.
    ("clocks.py", "raise StateError(self._why_not(shared, locked, differences))"),
    ("hands.py", "raise _lapsed(request.writer)"),
    ("mailbox.py", "raise NoAnswerError(f'{text}: {reason}' if reason else text)"),
    ("session.py", "raise"),
    # They are about a rate, or about others that are at work, not about a time that has passed.
    ("access.py", "raise too_many(self._user)"),
    ("eeproms.py", "BusyError"),
}


def time_outs(tree: ast.AST) -> Iterator[ast.AST]:
    """What is raised, or returned as an error, because a time has passed."""
    for node in ast.walk(tree):
        bodies: list[ast.stmt] = []
        if isinstance(node, ast.If) and PASSED.search(ast.unparse(node.test)):
            bodies = node.body
        elif isinstance(node, ast.ExceptHandler) and node.type is not None:
            bodies = node.body if "TimeoutError" in ast.unparse(node.type) else []
        for statement in bodies:
            for inner in ast.walk(statement):
                error = isinstance(inner, ast.Return) and "Error(" in ast.unparse(inner)
                if error or isinstance(inner, ast.Raise):
                    yield inner


def is_known(file: Path, text: str) -> bool:
    return any(
        file.name == name and text.startswith((known, f"raise {known}")) for name, known in OTHERS
    )


def test_each_message_says_how_long() -> None:
    found, silent = 0, []
    for file in SOURCES:
        for node in time_outs(ast.parse(file.read_text())):
            text = ast.unparse(node)
            found += 1
            if not SAYS.search(text) and not is_known(file, text):
                silent.append(f"{file.relative_to(ROOT)}:{node.lineno}: {text}")  # type: ignore[attr-defined]
    assert found > 15, "the search finds nothing any more"
    assert not silent, "\n".join(silent)


def test_no_message_writes_a_time_by_itself() -> None:
    """Else it lacks what changes it."""
    wrong = [
        f"{file.relative_to(ROOT)}: {match[0]}"
        for file in SOURCES
        for match in re.finditer(r"within \{[\w.]+(:g)?\} s\b", file.read_text())
        if file.name != "log.py"  # so many messages came within that time
    ]
    assert not wrong


@pytest.mark.parametrize(
    ("patience", "text"),
    [
        (Config().state_timeout, "10 s (state_timeout_s above all tables)"),
        (Config().dc.timeout, "5 s (timeout_s in [dc])"),
        (MailboxQueue().patience(), "1 s (mailbox_timeout_ms in its [[slave]] table)"),
        (Timeout(0.5), "0.5 s"),
    ],
)
def test_a_time_with_its_key(patience: Timeout, text: str) -> None:
    assert str(patience) == text


def keys() -> set[str]:
    """Keys with their tables, as messages about time-outs say them."""
    return {
        node.value
        for file in SOURCES
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
        if re.fullmatch(r"\w+ (above all tables|in (its )?\[.+\]( table)?)", node.value)
        if re.match(r"\w+_(s|ms|us) ", node.value)
    }


def test_a_key_can_be_written_as_the_message_says(tmp_path: Path) -> None:
    found = keys()
    assert len(found) > 4
    for text in found:
        key, _, where = text.partition(" ")
        (table,) = re.findall(r"\[.+\]", where) or [""]
        file = tmp_path / "ecatd.toml"
        for name, known in ((key, True), (f"{key}x", False)):
            file.write_text(f"{table}\n{name} = 1000\n")
            try:
                load_config(file)
                said = ""
            except ConfigError as error:  # such as a table that lacks others
                said = str(error)
            assert ("is not a key" not in said) == known, f"{text}: {said}"


def test_a_state_that_is_not_reached() -> None:
    patience = Config().state_timeout
    late = SlaveState(0, AlState.PREOP, 0)
    names(why_not_reached(late, AlState.OP, patience), "OP within 10 s (state_timeout_s", "PREOP")
    refused = SlaveState(0, 0x12, 0x0036)
    assert "within" not in why_not_reached(refused, AlState.OP, patience), "nobody has waited"
