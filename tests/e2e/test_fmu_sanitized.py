"""The C code of an FMU under sanitizers: whatever is called, with whatever values and files."""

import re
import subprocess
import uuid
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from conftest import SHM
from ecatd.description.bus import Bus
from ecatd.master.engine.process_image import lay_out
from ecatd.master.engine.shared_memory import SharedMemory
from ecatdev import sample_buses
from ecatgen.fmu import generate_fmu

pytestmark = pytest.mark.long


HARNESS = Path(__file__).with_name("fmu_misuse.c")


@contextmanager
def served(bus: Bus) -> Iterator[None]:
    """The shared memory of a bus, without anything that exchanges it."""
    shared = SharedMemory(bus.name, SHM)
    shared.fill(bus, lay_out(bus, set()), 5_000_000, 500_000_000)
    shared.header.cycle_end_ns = 1 << 62  # "just now" for ever
    shared.publish()
    try:
        yield
    finally:
        shared.close()


@pytest.mark.parametrize("fmi", [2, 3])
def test_whatever_is_called(fmi: int, tmp_path: Path, compiler: str) -> None:
    """Entries of all types; nobody exchanges the bus, so that a step with outputs fails."""
    bus = sample_buses.awkward()
    bus.name = f"m{uuid.uuid4().hex[:8]}"
    fmu = tmp_path / "fmu"
    with zipfile.ZipFile(generate_fmu(bus, "Plant", tmp_path, fmi).fmu) as archive:
        archive.extractall(fmu)
    table = (fmu / "resources" / "plant.txt").read_text()
    ((token, variables),) = re.findall(r"^token (.+?)$.*^variables (\d+)$", table, re.M | re.S)
    program = tmp_path / "misuse"
    sources = [str(path) for path in sorted((fmu / "sources").rglob("*.c"))]
    flags = ["-g", "-O1", f"-DFMI={fmi}", "-D_GNU_SOURCE", f"-I{fmu / 'sources'}"]
    flags += ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-Wall", "-Werror"]
    done = subprocess.run(
        [compiler, *flags, str(HARNESS), *sources, "-lm", "-o", str(program)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    damaged = tmp_path / "damaged"
    damaged.mkdir()
    with served(bus):
        result = subprocess.run(
            [str(program), str(fmu / "resources"), token, bus.name, variables, str(damaged)],
            capture_output=True,
            text=True,
            check=False,
        )
    assert (result.returncode, result.stderr) == (0, "")
    assert re.fullmatch(
        r"\d{4,} messages, \d{4,} calls refused, \d+ altered tables accepted\n", result.stdout
    )
