"""Starts the machine once for all tests of this folder, which follow each other as a day does."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from system_machine import Machine, segment, wires

ROOT = Path(__file__).parents[2]
IMAGE = ROOT / "build/machine"
PACKAGES = ROOT / "build/deb"


@pytest.fixture(scope="session")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Machine]:
    """The machine, with the Debian packages in `/files`."""
    assert IMAGE.exists(), "use make test-system"
    packages = sorted(PACKAGES.glob("*.deb"))
    assert packages, "use make test-system"
    helpers = sorted((Path(__file__).parent / "guest").glob("*.py"))
    folder = tmp_path_factory.mktemp("machine")
    with wires(), Machine(IMAGE, folder, [*packages, *helpers]) as running:
        yield running


@pytest.fixture(scope="session")
def drive(machine: Machine) -> Iterator[str]:
    """The simulated segment at the first card: its name for `Simulator`."""
    with segment("troll", 0) as name:
        yield name
