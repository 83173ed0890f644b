"""One rule for values: what is written is rounded, held and refused alike, whoever writes it.

10 000 values go through the clients for C, C++ and Python, the headers of Modelica blocks, and FMUs
of both versions. The bits that each of them commits are those of the rule; so is what it refuses.
"""

import ctypes
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import pytest

pytest.importorskip("fmpy", reason="FMPy is not installed (extra 'test')")

from fmpy.fmi1 import FMICallException
from raw_slot import RawSlot
from value_cases import RIG, SHAPES, Case, bits_of, cases, configuration, expected, first_case

from conftest import Daemon
from ecatd.base.errors import UsageError
from ecatd.shm import contract as shm
from ecatsim.control import Simulator
from player import BEAR, DISCARD, Model

pytestmark = [pytest.mark.bus, pytest.mark.long]

HERE = Path(__file__).parent
PROGRAMS = HERE / "value_clients"
INCLUDE = HERE.parents[1] / "codegen/ecatgen/modelica/EtherCAT/Resources/Include"
CONFIGURATION = "[gateway]\nlisten = []\n[outputs]\nlease_max_ms = 60000\nlease_cycles = 60000\n"
ERANGE = -10
NEAREST, OTHERS = "N", ("U", "D", "Z")
"""Rounding modes of the thread that writes."""

LEGAL = tuple(first_case(number) for number in range(len(SHAPES)))
PHYSICAL = tuple(
    Case(case.number, "p", case.value * case.shape.scale + case.shape.offset) for case in LEGAL
)
"""Values that all outputs take, as raw and as physical ones."""

ALL = (*LEGAL, *cases())


class Answer(NamedTuple):
    """What became of a value.

    Attributes:
        case: The value.
        code: What the client said: 0, or `ERANGE`.
        bits: The bits of the output in the commit that followed.
    """

    case: Case
    code: int
    bits: int


@pytest.fixture(scope="module")
def values(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Daemon]:
    """A daemon whose only slave has outputs of all shapes."""
    folder = tmp_path_factory.mktemp("values")
    daemon = Daemon(folder, str(RIG), config=CONFIGURATION + configuration()).wait_ready()
    yield daemon
    assert daemon.stop() == 0
    daemon.close()


# --- programs in C and C++ ------------------------------------------------------------------------


def compiled(source: str, folder: Path) -> Path:
    """A program of `value_clients`, compiled as users compile theirs."""
    for package in import_module("ecatgen").__path__:
        client = Path(package) / "_client"
        if client.exists():
            break
    program = folder / Path(source).stem
    subprocess.run(
        [
            *("g++" if source.endswith("cpp") else "gcc", "-O2", "-Wall", "-Wextra", "-Werror"),
            *(f"-I{client / 'include'}", f"-I{INCLUDE}", f"-I{PROGRAMS}", PROGRAMS / source),
            *(client / "lib" / "libecat.a", "-lm", "-o", program),
        ],
        check=True,
    )
    return program


@contextmanager
def running(
    program: Path, bus: str, rounding: str, asked: Sequence[Case], *options: str
) -> Iterator[list[Answer]]:
    """What a program of `value_clients` makes of values; it keeps its outputs meanwhile."""
    file = program.with_suffix(".values")
    file.write_text("".join(case.line() + "\n" for case in asked))
    with subprocess.Popen(
        [program, bus, rounding, file, *options],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        lines = [line.split() for line in iter(process.stdout.readline, "done\n") if line]
        assert len(lines) == len(asked), process.wait()
        yield [
            Answer(case, int(code), int(bits, 16))
            for case, (code, bits) in zip(asked, lines, strict=True)
        ]
        process.stdin.close()
        assert process.wait() == 0


# --- clients in this process ----------------------------------------------------------------------


@contextmanager
def rounding_to(mode: str) -> Iterator[None]:
    """Changes the rounding mode of this thread."""
    modes = {"N": 0, "D": 0x400, "U": 0x800, "Z": 0xC00}
    libm = ctypes.CDLL("libm.so.6")
    assert libm.fesetround(modes[mode]) == 0
    try:
        yield
    finally:
        libm.fesetround(0)


def committed(slot: RawSlot, number: int, offset: int) -> int:
    """The bits of an output, which begins at bit `offset`, in the last commit."""
    image = slot.committed()
    at = slot.at + slot.header.images_offset
    at += slot.bell.commit_seq % shm.IMAGES * slot.header.image_stride
    at += shm.size("ecat_out_image") + image.bytes + offset // 8 - image.first
    word = int.from_bytes(slot.memory[at : at + 9], "little") >> offset % 8
    return word & (1 << SHAPES[number].bits) - 1


@contextmanager
def python(bus: Daemon, asked: Sequence[Case]) -> Iterator[list[Answer]]:
    with bus.client() as client:
        outputs = client.signals()
        assert [output.name for output in outputs] == [shape.name for shape in SHAPES]
        with client.claim(0, lease=60):
            answers, slot = [], RawSlot(bus.bus)
            for case in asked:
                output, code = outputs[case.number], 0
                try:
                    if case.kind == "p":
                        output.value = case.value
                    else:
                        output.raw = case.value
                except UsageError:
                    code = ERANGE
                client.commit()
                answers.append(Answer(case, code, committed(slot, case.number, output.bit_offset)))
            yield answers


def settable(kind: str, case: Case) -> Any:
    """The value for a variable of an FMU, or None: it has no such value."""
    if kind in ("Real", "Float64"):
        fits = case.kind == ("p" if case.shape.is_analog else "r") or not case.shape.is_analog
        return float(case.value) if fits and float(case.value) == case.value else None
    if (case.kind == "p" and case.shape.is_analog) or not float(case.value).is_integer():
        return None
    whole = int(case.value)
    if kind == "Boolean":
        return bool(whole) if whole in (0, 1) else None
    bits = 32 if kind == "Integer" else int(kind.lstrip("UInt"))
    low = 0 if kind.startswith("U") else -(1 << bits - 1)
    return whole if low <= whole < low + (1 << bits) else None


@contextmanager
def fmu(
    bus: Daemon, model: Model, asked: Sequence[Case], rounding: str = NEAREST
) -> Iterator[list[Answer]]:
    names = [
        next(name for name, v in model.variables.items() if address in v.description)
        for address in (f"(0x{0x7000 + n:04X}:00)" for n in range(len(SHAPES)))
    ]
    with bus.client() as client:
        offsets = [output.bit_offset for output in client.signals()]
    parameters = BEAR | {"bus": bus.bus, "waitForBus": False, "lease": 60.0}
    with model.play(**parameters) as player:
        answers: list[Answer] = []
        slot = None
        for case in asked:
            name, code = names[case.number], 0
            value = settable(model.variables[name].type, case)
            if value is None:
                continue
            with rounding_to(rounding):
                try:
                    player.set(name, value)
                except FMICallException as refused:
                    code = ERANGE if refused.status == DISCARD else -1
                player.step()
            slot = slot or RawSlot(bus.bus)
            answers.append(Answer(case, code, committed(slot, case.number, offsets[case.number])))
        yield answers


# --- tests ----------------------------------------------------------------------------------------


def check(answers: Sequence[Answer], least: int) -> list[int]:
    """The answers are those of the rule; returns what all outputs have at last."""
    assert len(answers) >= least
    outputs = [-1] * len(SHAPES)
    wrong = []
    for case, code, bits in answers:
        wanted = expected(case)
        if wanted is not None:
            outputs[case.number] = wanted
        if (code, bits) != (0 if wanted is not None else ERANGE, outputs[case.number]):
            wrong.append((case.shape.name, case.kind, case.value, code, hex(bits), wanted))
            outputs[case.number] = bits
    assert not wrong, f"{len(wrong)} of {len(answers)}: {wrong[:20]}"
    return outputs


def check_wire(daemon: Daemon, outputs: Sequence[int]) -> None:
    """The slave has got them."""
    deadline = time.monotonic() + 120
    with Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
        for number, bits in enumerate(outputs):
            if bits < 0:
                continue
            while bits_of(SHAPES[number], simulator.get(0, 0x7000 + number)) != bits:
                assert time.monotonic() < deadline, SHAPES[number]


def test_there_are_values_of_all_kinds() -> None:
    assert len(ALL) > 10_000
    assert repr(ALL[len(LEGAL) :]) == repr(tuple(cases()))  # NaN is not equal to itself
    refused = sum(expected(case) is None for case in ALL)
    assert len(ALL) // 5 < refused < len(ALL) // 2
    assert {case.kind for case in ALL} == {"r", "i", "p"}


@pytest.mark.parametrize("rounding", [NEAREST, *OTHERS])
@pytest.mark.parametrize("language", ["c", "cpp"])
def test_programs(language: str, rounding: str, values: Daemon, tmp_path: Path) -> None:
    program = compiled(f"values.{language}", tmp_path)
    with running(program, values.bus, rounding, ALL) as answers:
        check_wire(values, check(answers, len(ALL)))


@pytest.mark.parametrize("rounding", [NEAREST, *OTHERS])
@pytest.mark.parametrize("meaning", ["raw", "physical"])
def test_blocks(meaning: str, rounding: str, values: Daemon, tmp_path: Path) -> None:
    """Those written by hand, which have raw values, and those that have the meaning of the bus."""
    program = compiled("values_blocks.c", tmp_path)
    asked = [
        case
        for case in (ALL if meaning == "raw" else (*PHYSICAL, *ALL))
        if (case.kind == "p") == (meaning == "physical")
        and (case.kind != "i" or -(1 << 31) <= case.value < 1 << 31)
    ]
    with running(program, values.bus, rounding, asked, meaning) as answers:
        check_wire(values, check(answers, 4000))


def test_the_client_for_python(values: Daemon) -> None:
    with python(values, ALL) as answers:
        check_wire(values, check(answers, len(ALL)))


@pytest.mark.parametrize("fmi", [2, 3])
def test_fmus(fmi: int, values: Daemon, tmp_path: Path) -> None:
    values.ctl("generate", "Plant", str(tmp_path), "--fmu", "--fmi", str(fmi))
    model = Model(tmp_path / "Plant.fmu")
    with fmu(values, model, (*PHYSICAL, *ALL)) as answers:
        check_wire(values, check(answers, 4500))
    for part, rounding in enumerate(OTHERS):
        with fmu(values, model, (*PHYSICAL, *ALL[part :: len(OTHERS)]), rounding) as answers:
            check(answers, 1500)
