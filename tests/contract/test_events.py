"""Each kind of event is a row of `ecatd.operations.events`; code and pages have the same."""

import ast
import re
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from ecatd.base.log_levels import LEVELS
from ecatd.operations.bus import Event
from ecatd.operations.events import FACTS, KINDS, PUBLISHED, SEVERITIES, new_event
from ecatdev import event_pages
from ecatdev.zenoh_keys.types import problems

ROOT = Path(__file__).parents[2]
COMMAND = "PYTHONPATH=tools .venv/bin/python -m ecatdev.event_pages"
ORDER = ("debug", "info", "notice", "warning", "error")
COMMON = {"text", "times", "severity"}
EITHER = "tell"
"""Name of a variable that is the method for one of several levels."""


class Use(NamedTuple):
    """A place in the code that names a kind.

    Attributes:
        kind: The kind.
        level: Level of the line of the log; empty if it is published.
        facts: The facts that are published.
        whole: Whether there are no others.
    """

    kind: str
    level: str
    facts: frozenset[str]
    whole: bool


def names_in(nodes: Iterable[ast.expr | None]) -> set[str]:
    """The names among some expressions."""
    return {
        node.value
        for node in nodes
        if isinstance(node, ast.Constant) and re.fullmatch("[a-z_]+", str(node.value))
    }


def reports(call: ast.Call) -> Iterator[Use]:
    """What a call of a `Reporter` writes to the log and publishes."""
    match call:
        case ast.Call(func=ast.Attribute(attr="_report"), args=[kind, _, facts, *_]):
            keys = names_in(facts.keys) if isinstance(facts, ast.Dict) else set()
            for name in names_in([kind]):
                yield Use(name, "", frozenset(keys), isinstance(facts, ast.Dict))
        case ast.Call(
            func=ast.Attribute(value=ast.Attribute(attr="_report"), attr="write"), args=[kind, *_]
        ):
            pass
        case _:
            return
    other = any(item.arg in ("good", "level") for item in call.keywords)
    for name in names_in([kind]):
        yield Use(name, EITHER if other else KINDS[name].severity, frozenset(), False)


@cache
def uses() -> list[Use]:
    """Every place that publishes an event of a kind, or gives it to the log."""
    return [*find_uses()]


def find_uses() -> Iterator[Use]:
    for file in (ROOT / "daemon" / "ecatd").rglob("*.py"):
        nodes = list(ast.walk(ast.parse(file.read_text())))
        for node in nodes:
            if isinstance(node, ast.Call):
                yield from reports(node)
            match node:
                case ast.Call(
                    func=ast.Attribute(attr="publish" | "_publish") | ast.Name(id="new_event"),
                    args=[kind],
                    keywords=[*given],
                ):
                    facts = frozenset(item.arg for item in given if item.arg)
                    whole = all(item.arg for item in given)
                    yield from (Use(name, "", facts, whole) for name in names_in([kind]))
                case ast.Call(
                    func=ast.Attribute(attr=level) | ast.Name(id="tell" as level),
                    args=[_, kind, *_],
                ) if level in {*LEVELS, EITHER}:
                    yield from (Use(name, level, frozenset(), False) for name in names_in([kind]))
        if "EventType(" in file.read_text():  # it uses the names of the engine's events
            for case in (node for node in nodes if isinstance(node, ast.match_case)):
                for part in ast.walk(case.pattern):
                    if isinstance(part, ast.Attribute):
                        yield Use(part.attr.lower(), "", frozenset(), False)
                        yield Use(part.attr.lower(), EITHER, frozenset(), False)


def test_r44_every_event_of_the_code_is_a_kind() -> None:
    assert {use.kind for use in uses() if not use.level} == PUBLISHED
    logged = {name for name, kind in KINDS.items() if kind.logged}
    assert {use.kind for use in uses() if use.level} == logged


def test_the_facts_of_the_code_are_those_of_the_kind() -> None:
    for use in uses():
        known = set(KINDS[use.kind].facts)
        always = {name for name in known if not name.endswith("?")}
        assert use.facts <= {name.rstrip("?") for name in known} | COMMON, use
        assert not use.whole or always <= use.facts, use
    used = {name.rstrip("?") for kind in KINDS.values() for name in kind.facts}
    assert used == FACTS.keys()
    for kind in KINDS.values():
        assert kind.values.keys() <= {name.rstrip("?") for name in kind.facts}, kind.name


def test_the_severity_is_that_of_the_worst_line() -> None:
    for name, kind in KINDS.items():
        assert kind.severity in SEVERITIES, name
        assert new_event(name, text="x")["severity"] == kind.severity
        levels = [use.level for use in uses() if use.kind == name and use.level]
        sure = [ORDER.index(level) for level in levels if level != EITHER]
        severity = ORDER.index(kind.severity)
        assert severity >= max(sure, default=0), name
        assert severity == max(sure, default=severity) or EITHER in levels, name


def test_what_is_made_of_the_kinds_is_up_to_date() -> None:
    assert event_pages.CATALOG.read_text() == event_pages.catalog(), f"run: {COMMAND}"
    assert event_pages.PAGE.read_text() == event_pages.page(), f"run: {COMMAND}"


def test_commands_of_the_journal_can_be_copied() -> None:
    catalog = event_pages.catalog().partition("\n\n")[2]
    assert "ecatctl state @ECAT_SLAVE@ OP" in catalog
    assert not re.search(r"[`{}]|\]\(", catalog), "no Markdown, and no names that nobody fills in"


def test_an_event_that_lacks_a_fact_is_found() -> None:
    def wrong(**facts: Any) -> list[str]:
        event = {**new_event("conflict", text="x", **facts), "sequence": 1, "instance": 2}
        return [*problems(event, Event)]

    facts = {name: FACTS[name].type() for name in KINDS["conflict"].facts}
    assert wrong(**facts) == []
    assert len(wrong(**{**facts, "slave": "3"})) == len(wrong(**facts, more=1)) == 1
    del facts["owner"]
    assert len(wrong(**facts)) == 1
