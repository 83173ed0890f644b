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
from ecatd.config.resolve.can import CanChannel
from ecatd.description.bus import Bus
from ecatd.etg.can_terminals import EL6751, Mode
from ecatd.etg.pdo import Entry
from ecatd.master.engine.process_image import lay_out
from ecatd.master.engine.shared_memory import SharedMemory
from ecatdev import sample_buses
from ecatgen.can import CanFile, CanMessage, CanSignal, Selector
from ecatgen.fmu import generate_fmu

pytestmark = pytest.mark.long


HARNESS = Path(__file__).with_name("fmu_misuse.c")


CHANNEL = CanChannel(
    slave=0,
    terminal=EL6751,
    layout=EL6751.layouts[29],
    mode=Mode.BUFFERED,
    bit_rate=500,
    cycle_us=1000,
    identifiers=29,
    receive_queue=10,
    send_queue=10,
    flags=0,
    filters=(),
    safe=(),
    bus_off_restart_ms=0,
    remarks=(),
)
"""A CAN bus behind slave 0, which is no terminal in truth."""


@contextmanager
def served(bus: Bus) -> Iterator[None]:
    """The shared memory of a bus, without anything that exchanges it."""
    shared = SharedMemory(bus.name, SHM)
    shared.fill(bus, lay_out(bus, set()), 5_000_000, 500_000_000, [CHANNEL])
    shared.header.cycle_end_ns = 1 << 62  # "just now" for ever
    shared.publish()
    try:
        yield
    finally:
        shared.close()


def messages(bus: Bus) -> list[CanFile]:
    """CAN messages with signals of all kinds."""
    slave = bus.slaves[0]
    page = CanSignal(Entry(1, 0, "page", 0x1B, 8), 0)
    signals = (
        page,
        CanSignal(Entry(1, 0, "real", 0x08, 32), 39, True, Selector(0, 8, False, 1, 2)),
        CanSignal(Entry(1, 0, "signed", 0x15, 12, scale=0.5, unit="V"), 8),
        CanSignal(Entry(1, 0, "bit", 0x1B, 1), 20),
    )
    made = [
        CanMessage("Message", 5, False, 8, True, signals=signals),
        CanMessage("Message", 5, True, 8, False, 10, signals=signals),
        CanMessage("Wide", 6, True, 8, False, signals=(CanSignal(Entry(1, 0, "w", 0x1B, 64), 0),)),
    ]
    return [CanFile(0, slave.given_name, slave.vendor, slave.product, "file", tuple(made))]


@pytest.mark.parametrize("can", [False, True])
@pytest.mark.parametrize("fmi", [2, 3])
def test_whatever_is_called(fmi: int, can: bool, tmp_path: Path, compiler: str) -> None:
    """Entries of all types; nobody exchanges the bus, so that a step with outputs fails."""
    bus = sample_buses.awkward()
    bus.name = f"m{uuid.uuid4().hex[:8]}"
    fmu = tmp_path / "fmu"
    with zipfile.ZipFile(
        generate_fmu(bus, "Plant", tmp_path, fmi, messages=messages(bus) if can else ()).fmu
    ) as archive:
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
