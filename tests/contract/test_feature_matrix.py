"""The feature matrix of the simulator names tests that exist."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PREFIXES = {"unit": "test_ecatsim_", "bus": "test_simulator_", "fuzz": "test_"}


def rows() -> list[tuple[str, str]]:
    """Feature and tests of each row."""
    text = (ROOT / "docs" / "simulator-internals.md").read_text()
    section = text.split("\n## Features\n")[1].split("\n## ")[0]
    cells = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in section.splitlines()
        if line.startswith("|")
    ]
    return [(feature, tests) for feature, tests in cells if tests not in ("tests", "---")]


@pytest.mark.parametrize(("feature", "tests"), rows())
def test_every_feature_is_shown(feature: str, tests: str) -> None:
    assert feature
    for group in tests.split(";"):
        where, names = group.split(":")
        folder, name = where.strip().split("/")
        file = ROOT / "tests" / folder / f"{PREFIXES[folder]}{name}.py"
        defined = set(re.findall(r"^def (test_\w+)", file.read_text(), re.MULTILINE))
        missing = {test.strip() for test in names.split(",")} - defined
        assert not missing, f"{file.name} has no such tests"
