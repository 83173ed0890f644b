"""The protocols of the shared memory as models in Promela, each checked in all its states by spin.

A model says which code it stands for, and names its invariants. It also names defects, which can be
switched on: they show that the model would find them.
"""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

pytestmark = pytest.mark.long


HERE = Path(__file__).parent
MODELS = [("snapshot",), ("commit",), ("claim",), ("claim", "COMPETE"), ("request",), ("limits",)]
DEFECTS = [
    ("snapshot", "NO_ODD"),
    ("snapshot", "NO_CHECK"),
    ("commit", "SLACK=3"),
    ("claim", "RESET"),
    ("claim", "NO_STAMP"),
    ("claim", "NO_LEASE"),
    ("claim", "COMPETE", "NO_OWNER"),
    ("request", "REUSE"),
    ("request", "NO_CLEAR"),
    ("request", "EAGER"),
    ("limits", "IN_PLACE"),
    ("limits", "NO_WAIT"),
]


def errors(folder: Path, model: str, *switches: str) -> int:
    """How many errors spin finds until it stops, at the first; fails unless it saw all states."""
    if not shutil.which("spin"):
        pytest.skip("spin is not installed (Debian: apt-get install spin)")
    made = [*("spin", "-a"), *(f"-D{switch}" for switch in switches), HERE / f"{model}.pml"]
    subprocess.run(made, cwd=folder, check=True, capture_output=True)
    options = ["-O2", "-w", "-DSAFETY", "-DMEMLIM=1500"]
    subprocess.run(["gcc", *options, "pan.c", "-o", "pan"], cwd=folder, check=True)
    result = subprocess.run(
        ["./pan", "-m1000000"], cwd=folder, check=True, capture_output=True, text=True
    ).stdout
    assert "max search depth too small" not in result
    assert "out of memory" not in result
    assert "memory limit" not in result
    found = re.search(r"errors: (\d+)", result)
    assert found, result
    return int(found[1])


@pytest.mark.parametrize("model", MODELS, ids="-".join)
def test_r25_the_invariants_hold_in_all_states(model: tuple[str, ...], tmp_path: Path) -> None:
    assert errors(tmp_path, *model) == 0


@pytest.mark.parametrize("model", DEFECTS, ids="-".join)
def test_a_defect_is_found(model: tuple[str, ...], tmp_path: Path) -> None:
    assert errors(tmp_path, *model) == 1
