"""The tables of features, of ecatd and of the simulator, name tests that exist."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SIMULATOR = {"unit": "test_ecatsim_", "bus": "test_simulator_"}
NOT_THERE = "–"


def rows(document: str, *sections: str) -> list[list[str]]:
    """The cells of each row of the tables in some sections."""
    text = (ROOT / "docs" / document).read_text()
    lines = [
        line
        for section in sections
        for line in text.split(f"\n## {section}\n")[1].split("\n## ")[0].splitlines()
    ]
    cells = [[c.strip() for c in line.strip("|").split("|")] for line in lines if line[:1] == "|"]
    return [row for row in cells if row[-1] not in ("tests", "---")]


def check(tests: str, prefixes: dict[str, str]) -> None:
    for group in tests.split(";"):
        where, names = group.split(":")
        folder, name = where.strip().split("/")
        file = ROOT / "tests" / folder / f"{prefixes.get(folder, 'test_')}{name}.py"
        defined = set(re.findall(r"^def (test_\w+)", file.read_text(), re.MULTILINE))
        missing = {test.strip() for test in names.split(",")} - defined
        assert not missing, f"{file.name} has no such tests"


@pytest.mark.parametrize(("feature", "tests"), rows("simulator-internals.md", "Features"))
def test_every_feature_of_the_simulator_is_shown(feature: str, tests: str) -> None:
    assert feature
    check(tests, SIMULATOR)


def test_all_cases_have_a_row() -> None:
    numbers = [row[0] for row in rows("reliability.md", "Cases")]
    assert numbers == [f"R{number:02}" for number in range(1, 48)]


@pytest.mark.parametrize("row", rows("reliability.md", "Cases"))
def test_every_case_is_shown(row: list[str]) -> None:
    check(row[-1], {})
    for test in re.findall(r"test_\w+", row[-1]):
        assert row[0].lower() in test.split("_"), f"{test} does not name its case, {row[0]}"


@pytest.mark.parametrize("row", rows("reliability.md", "Contradicting witnesses"))
def test_every_contradiction_is_shown(row: list[str]) -> None:
    check(row[-1], {})


@pytest.mark.parametrize("row", rows("features.md", "Master classes", "Faults"))
def test_every_feature_of_the_master_is_shown(row: list[str]) -> None:
    tests = row[-1]
    if tests == NOT_THERE:
        assert row[-2].startswith(("no", "only"))
    else:
        check(tests, {})
