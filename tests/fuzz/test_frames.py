"""Random frames against the slave controllers, with sanitizers: no crash, no hang, no race."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest
from mutations import inputs

pytestmark = pytest.mark.long


ROOT = Path(__file__).parents[2]
ESC = ROOT / "simulator" / "esc"
SANITIZERS = {"memory": "address,undefined", "races": "thread"}
ALL_EVENTS = 0x3FF
FRAMES = inputs(50_000)


@pytest.fixture(scope="session")
def driver(tmp_path_factory):
    """Builds the driver with a sanitizer; skips where the compiler has none."""
    folder = tmp_path_factory.mktemp("fuzz")
    built: dict[str, Path] = {}

    def build(kind: str) -> Path:
        if kind in built:
            return built[kind]
        flag = f"-fsanitize={SANITIZERS[kind]}"
        if not shutil.which("gcc"):
            pytest.skip("gcc is not installed")
        probe = folder / "probe.c"
        probe.write_text("int main(void) { return 0; }\n")
        try_it = subprocess.run(["gcc", flag, probe, "-o", folder / "probe"], check=False)
        if try_it.returncode or subprocess.run([folder / "probe"], check=False).returncode:
            pytest.skip(f"programs built with {flag} do not run here")
        sources = [*sorted(ESC.glob("*.c")), *sorted(Path(__file__).parent.glob("*.c"))]
        program = folder / kind
        subprocess.run(
            [
                *("gcc", "-std=c11", "-D_GNU_SOURCE", "-O1", "-g", "-Wall", "-Wextra", "-Werror"),
                *(flag, "-fno-sanitize-recover=all", f"-I{ESC}", *sources, "-o", program),
                *("-lpthread", "-lm"),
            ],
            check=True,
        )
        built[kind] = program
        return program

    return build


def run(program, seed, frames, slaves, *mode):
    """What the driver reached."""
    result = subprocess.run(
        [program, str(seed), str(frames), str(slaves), *mode],
        capture_output=True,
        text=True,
        env={**os.environ, "TSAN_OPTIONS": "halt_on_error=1"},
        check=False,
    )
    assert result.returncode == 0, f"seed {seed}: {result.stderr[-4000:]}"
    assert result.stderr == ""
    return json.loads(result.stdout)


def check_depth(found, frames, share, often=100):
    """The frames did not bounce off the surface: they reached what is behind every command."""
    assert found["answered"] + found["refused"] >= frames
    assert found["answered"] > frames * share
    assert found["counted"] > frames * share, "datagrams that slaves processed"
    for what in ("mails_taken", "mails_put", "rewired", "faults"):
        assert found[what] > often, what


@pytest.mark.parametrize(("seed", "slaves"), [(1, 1), (2, 5), (3, 32)])
def test_memory(driver, seed, slaves):
    found = run(driver("memory"), seed, FRAMES, slaves)
    check_depth(found, FRAMES, 0.3)
    assert found["event_bits"] == ALL_EVENTS, "each event came at least once"


@pytest.mark.parametrize("kind", SANITIZERS)
def test_device_side_in_a_thread(driver, kind):
    """How far the threads get beside each other is up to the machine."""
    found = run(driver(kind), 4, FRAMES, 5, "threads")
    check_depth(found, FRAMES, 0.01, often=3)
    assert found["event_bits"].bit_count() > 5, "most kinds of events came at least once"


def test_frames_depend_on_the_seed_only(driver):
    """So a seed that fails can be tried again; clocks go on, and what they say differs."""
    digests = [run(driver("memory"), seed, 20_000, 5)["digest"] for seed in (6, 6, 7)]
    assert digests[0] == digests[1] != digests[2]
