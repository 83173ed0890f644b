"""The cyclic engine, and the relay, between a bus and clients that do what they must not, with
sanitizers.
"""

import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest
from mutations import inputs

pytestmark = pytest.mark.long


HERE = Path(__file__).parent
ROOT = HERE.parents[1]
CYCLIC = ROOT / "daemon" / "cyclic"
SOURCES = (
    *("clock", "control", "copies", "engine", "frame_ring", "frames", "outputs", "publish"),
    *("relay", "setup", "slots", "thread", "wake", "ports"),
)
SANITIZERS = {"memory": "address,undefined", "races": "thread"}
CYCLES = inputs(3_000)
GOOD_EXCHANGES = 300  # however many are late on a busy machine
FRAMES = inputs(1_000)


@pytest.fixture(scope="session")
def driver(tmp_path_factory):
    """Builds the driver with a sanitizer; skips where the compiler has none."""
    folder = tmp_path_factory.mktemp("engine")

    def build(kind: str, name: str) -> Path:
        flag = f"-fsanitize={SANITIZERS[kind]}"
        if not shutil.which("gcc"):
            pytest.skip("gcc is not installed")
        probe = folder / "probe.c"
        probe.write_text("int main(void) { return 0; }\n")
        try_it = subprocess.run(["gcc", flag, probe, "-o", folder / "probe"], check=False)
        if try_it.returncode or subprocess.run([folder / "probe"], check=False).returncode:
            pytest.skip(f"programs built with {flag} do not run here")
        program = folder / f"{name}-{kind}"
        subprocess.run(
            [
                *("gcc", "-std=c11", "-D_GNU_SOURCE", "-O1", "-g", "-Wall", "-Wextra", "-Werror"),
                # gcc says that its thread sanitizer knows no fences; what they order is atomic.
                *("-Wno-tsan", flag, "-fno-sanitize-recover=all"),
                *(f"-I{CYCLIC}", f"-I{ROOT / 'client_c' / 'include'}"),
                f"-I{ROOT / 'client_c' / 'src'}",
                *(CYCLIC / f"{source}.c" for source in SOURCES),
                *(ROOT / "client_c" / "src" / f"{source}.c" for source in ("histogram", "values")),
                HERE / "engine" / f"{name}.c",
                *("-o", program, "-lpthread", "-lm"),
            ],
            check=True,
        )
        return program

    return build


def run(program: Path, count: int, ports: int, *more: int) -> dict[str, int]:
    result = subprocess.run(
        [program, *map(str, (1, count, ports, *more))],
        capture_output=True,
        text=True,
        env={**os.environ, "TSAN_OPTIONS": "halt_on_error=1"},
        check=False,
    )
    assert result.returncode == 0, result.stderr[-4000:]
    found: dict[str, int] = json.loads(result.stdout)
    return found


@pytest.mark.parametrize("ports", [1, 2])
@pytest.mark.parametrize("kind", SANITIZERS)
def test_nothing_from_outside_ends_the_engine_or_mixes_frames(driver, kind, ports):
    found = run(driver(kind, "engine"), CYCLES, ports, GOOD_EXCHANGES)
    assert found["exchanges"] >= CYCLES
    # It was not left in peace.
    what_happened = ("damaged", "invented", "held", "swaps", "truncated", "late", "lost")
    for what in (*what_happened, "commits", "refused", "malformed", "copied", "ranges"):
        assert found[what] > 3, what
    assert found["snapshots"] > 1000


@pytest.mark.parametrize("ports", [1, 2])
@pytest.mark.parametrize("kind", SANITIZERS)
def test_the_relay_answers_or_keeps_silent_but_never_hangs_or_lies(driver, kind, ports):
    found = run(driver(kind, "relay"), FRAMES, ports)
    assert found["sent"] >= FRAMES
    assert found["answered"] > found["sent"] / 2
    assert found["answered"] + found["silent"] == found["sent"]
    for what in ("silent", "junk", "lost", "repeated", "damaged", "swaps", "follows"):
        assert found[what] > 3, what
    assert 3 < found["relayed"] < found["sent"], "with the engine, and without"
