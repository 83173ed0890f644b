"""The benchmarks run, briefly, so that they cannot rot; their page says what was measured."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

ROOT = Path(__file__).parents[2]


def benchmarks(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "benchmarks", *map(str, arguments)],
        cwd=ROOT,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1", "MPLCONFIGDIR": "/tmp"},
        text=True,
        capture_output=True,
        timeout=100,
        check=False,
    )


def test_simulator(tmp_path: Path) -> None:
    run = benchmarks("--quick", "--out", tmp_path)
    assert run.returncode == 0, run.stderr
    result = json.loads((tmp_path / "performance" / "simulator.json").read_text())
    cases = result["turn_around"]
    assert {case["slaves"] for case in cases} == {1, 8, 64, 200}
    for case in cases:
        for peer in ("echo", "simulator"):
            assert case[peer]["cycles"] > 0
            assert case[peer]["wrong"] == 0, "the working counter of every cycle is exact"
            assert 0 < case[peer]["p50"] <= case[peer]["p99"] <= case[peer]["max"]
    assert result["endurance"]["slaves"] == 200
    assert result["endurance"]["frames"] == 9
    assert result["endurance"]["wrong"] == 0
    assert all(len(times) == 1 and times[0] > 0 for times in result["start"].values())
    assert result["processing"]["fit"]["slave"] > 0
    assert [step["slaves"] for step in result["step"]] == [8, 8, 64, 200]
    for key in ("processor", "cores", "kernel", "governor", "revision"):
        assert result["machine"][key]
    page = (tmp_path / "performance.md").read_text()
    assert "turn-around, 64 slaves" in page
    assert result["machine"]["processor"] in page
    assert "</svg>" in (tmp_path / "performance" / "simulator.svg").read_text()


def test_without_results() -> None:
    run = benchmarks("--report-only", "--out", "/nowhere")
    assert run.returncode == 2
    assert run.stderr == (
        "benchmarks: there are no results in '/nowhere/performance': run without --report-only\n"
    )


def test_the_page_is_made_from_the_results(tmp_path: Path) -> None:
    """Nobody edits docs/performance.md by hand, or its results without it."""
    shutil.copytree(ROOT / "docs" / "performance", tmp_path / "performance")
    assert benchmarks("--report-only", "--out", tmp_path).returncode == 0
    made, kept = (folder / "performance.md" for folder in (tmp_path, ROOT / "docs"))
    assert made.read_text() == kept.read_text()
