"""Images that are read while they are written, and outputs that are taken while they are committed:
each is of one cycle, or of one commit.

The engine's own writer and reader of the shared memory run against the client library at full
speed, plain and with sanitizers. `ECAT_READS=100000000` (`make torn`) has so many reads of the
usual image; without it a hundredth.
"""

import json
import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

pytestmark = pytest.mark.long


HERE = Path(__file__).parent
ROOT = HERE.parents[1]
READS = int(os.environ.get("ECAT_READS", "400000"))
SIZES = (1, 8, 255, 256, 1498, 20000)
MOST = (256,)
"""Sizes that get more reads: all of READS, the others a share."""
KINDS = {"plain": None, "memory": "address,undefined", "races": "thread"}


@pytest.fixture(scope="module")
def driver(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], list[str]]:
    """The command that runs the driver, which is built when it is first asked for."""
    folder = tmp_path_factory.mktemp("torn")
    made: dict[str, list[str]] = {}

    def build(kind: str) -> list[str]:
        if kind not in made:
            made[kind] = [*(("setarch", "-R") if kind == "races" else ()), _build(folder, kind)]
        return made[kind]

    return build


def _build(folder: Path, kind: str) -> str:
    sanitizer = KINDS[kind]
    # gcc says that its thread sanitizer knows no fences; what they order is atomic.
    flags = [f"-fsanitize={sanitizer}", "-fno-sanitize-recover=all", "-Wno-tsan"]
    if sanitizer is None:
        flags = []
    probe = folder / "probe.c"
    probe.write_text("int main(void) { return 0; }\n")
    if subprocess.run(["gcc", *flags, probe, "-o", folder / "probe"], check=False).returncode:
        pytest.skip(f"gcc has no {sanitizer} sanitizer")
    program = folder / kind
    subprocess.run(
        [
            *("gcc", "-std=c11", "-D_GNU_SOURCE", "-O2", "-g", "-Wall", "-Wextra", "-Werror"),
            *flags,
            *(f"-I{ROOT / folder}" for folder in ("client_c/include", "client_c/src")),
            *(f"-I{ROOT / 'daemon' / 'cyclic'}", f"-I{HERE / 'torn'}"),
            *(ROOT / "daemon" / "cyclic").glob("*.c"),
            *(ROOT / "client_c" / "src").glob("*.c"),
            *(HERE / "torn").glob("*.c"),
            *("-o", program, "-lm", "-lpthread"),
        ],
        check=True,
    )
    return str(program)


def run(command: list[str], what: str, size: int, count: int) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*command, what, str(size), str(count)],
        env={**os.environ, "TSAN_OPTIONS": "halt_on_error=1"},
        text=True,
        capture_output=True,
        timeout=100 + count / 1000,
        check=False,
    )


def result(command: list[str], what: str, size: int, count: int) -> dict[str, int]:
    ended = run(command, what, size, count)
    assert (ended.returncode, ended.stderr) == (0, "")
    print(what, size, ended.stdout.strip())
    found: dict[str, int] = json.loads(ended.stdout)
    return found


def share(kind: str, size: int) -> int:
    """How many reads: fewer of large images, and under sanitizers."""
    count = READS if size in MOST else READS // 10
    return max(4000, count // (1 if kind == "plain" else 10) // (10 if size > 2000 else 1))


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("kind", KINDS)
def test_r25_every_image_is_of_one_cycle(
    driver: Callable[[str], list[str]], kind: str, size: int
) -> None:
    count = share(kind, size)
    found = result(driver(kind), "read", size, count)
    assert found["reads"] >= count  # more, until enough of them have met the writer
    assert found["met"] > count / 2000, "readers and writer hardly met"


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("kind", KINDS)
def test_r25_all_outputs_are_of_one_commit(
    driver: Callable[[str], list[str]], kind: str, size: int
) -> None:
    count = max(4000, share(kind, size) // 50)
    found = result(driver(kind), "commit", size, count)
    assert found["taken"] > count / 2000
    assert found["malformed"] == 0


def test_a_client_that_never_rests_is_heard(driver: Callable[[str], list[str]]) -> None:
    """It comes round to an image before the engine has read it, as a loop without a wait does."""
    found = result(driver("plain"), "hurry", 8, 5_000_000)
    assert found["taken"] > found["torn"]


@pytest.mark.parametrize(
    ("what", "said"),
    [("broken-read", "an image of two cycles"), ("broken-commit", "outputs of two commits")],
)
def test_what_is_torn_is_found(driver: Callable[[str], list[str]], what: str, said: str) -> None:
    """The counter-example: an unmarked page, and a commit that is changed after it was told."""
    ended = run(driver("plain"), what, 1498, 100_000_000)
    assert ended.returncode == 1
    assert said in ended.stderr
