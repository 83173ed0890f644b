"""Every call of every generated block, made on a simulated bus.

Each value that is read is what the Python client and the simulator say, and each value that is
written reaches its slave.
"""

import itertools
import random
import re
import struct
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest
from block_calls import Answer, Connector, Executor, connectors, of_header, of_modelica, program
from plant_calls import compile_program

from conftest import Daemon
from ecatd.etg.datatypes import DataType, is_real, value_range
from ecatdev import sample_buses
from ecatgen import generate
from ecatsim.control import Simulator

PATIENCE = 20.0
"""Seconds for a value to come about."""

RIG = str(Path(__file__).parents[1] / "rigs" / "data_types.py")
PROFILE = """
[[device]]
description = "Scaled"
vendor = 0xFFFF
product = [0xDA7A]
"""
PROFILE_ENTRY = """
[[device.entry]]
index = {index}
subindex = {subindex}
unit = "V"
scale = {scale}
offset = {offset}
"""
SCALED = {11: (0.5, -10.0), 15: (1e-3, 0.0), 16: (-2.0, 3.0), 29: (10 / 32767, 0.0)}
"""Scale and offset of an INTEGER16, UNSIGNED32, REAL32 and WORD of the rig."""


def header_of(out: Path) -> str:
    return (out / "Plant" / "Resources" / "Source" / "Plant.h").read_text()


def check_same_calls(out: Path) -> int:
    """Blocks make the same calls in Modelica as in C, in the same order; returns their number."""
    in_c = of_header(header_of(out))
    for name, calls in in_c.items():
        assert of_modelica((out / "Plant" / f"{name}.mo").read_text()) == calls
    return len(in_c)


@pytest.mark.parametrize("bus", [sample_buses.troll, sample_buses.awkward])
def test_c_makes_the_calls_of_the_blocks(bus: Callable[..., object], tmp_path: Path) -> None:
    made = bus()
    generate(made, "Plant", tmp_path)  # type: ignore[arg-type]
    assert check_same_calls(tmp_path) == len(made.slaves)  # type: ignore[attr-defined]


@pytest.fixture(scope="module")
def typed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Daemon]:
    """A daemon on the rig with all data types, some of which are scaled."""
    folder = tmp_path_factory.mktemp("typed")
    (folder / "profiles").mkdir()
    text = PROFILE + "".join(
        PROFILE_ENTRY.format(index=index, subindex=subindex, scale=scale, offset=offset)
        for subindex, (scale, offset) in SCALED.items()
        for index in (0x6000, 0x7000)
    )
    (folder / "profiles" / "types.toml").write_text(text)
    config = 'profiles = ["profiles"]\n[gateway]\nlisten = []\n'
    daemon = Daemon(folder, RIG, config=config, cycle_time_us=1000).wait_ready()
    yield daemon
    daemon.close()


@pytest.fixture(scope="module")
def types(tmp_path_factory: pytest.TempPathFactory, typed: Daemon) -> Path:
    """Its library."""
    folder = tmp_path_factory.mktemp("types")
    typed.ctl("generate", "Plant", str(folder / "out"))
    return folder / "out"


@contextmanager
def executing(compiler: str, out: Path, folder: Path, bus: str) -> Iterator[Executor]:
    """The program for a library, running."""
    header = header_of(out)
    executor = Executor(compile_program(compiler, program(header), out, folder), header, bus)
    try:
        yield executor
    finally:
        executor.close()


def raw_value(connector: Connector, random_: random.Random, turn: int = 0) -> float:
    """A raw value that the entry can hold, and a double and a Modelica Integer, too."""
    entry = connector.entry
    if entry.data_type == DataType.REAL32:
        return float(struct.unpack("f", struct.pack("f", random_.uniform(-1e6, 1e6)))[0])
    if is_real(entry.data_type):
        return random_.uniform(-1e6, 1e6)
    low, high = value_range(entry.data_type, entry.bits)
    if entry.bits == 1:
        return float(turn % 2 == 0)
    return float(random_.randint(max(low, -(2**53)), min(high, 2**53)))


def physical(connector: Connector, raw: float) -> float:
    return raw * connector.entry.scale + connector.entry.offset


def to_write(executor: Executor, raw: Sequence[float]) -> list[float]:
    return [physical(c, value) for c, value in zip(executor.writes, raw, strict=True)]


def check_reached(executor: Executor, simulator: Simulator, raw: Sequence[float]) -> None:
    """The slaves have these values; samples go on meanwhile, for the lease."""
    values = to_write(executor, raw)
    for connector, value in zip(executor.writes, raw, strict=True):
        place = (connector.slave, connector.entry.index, connector.entry.subindex)
        wanted = pytest.approx(value, rel=1e-12)
        until(
            executor, values, lambda _, place=place, wanted=wanted: simulator.get(*place) == wanted
        )


def check_types(executor: Executor, simulator: Simulator, rounds: int = 3) -> None:
    """Writes random values; they reach the slaves, come back on the wires, and are read."""
    assert {c.kind for c in executor.writes} == {"boolean", "integer", "real"}
    wired = {(c.slave, c.entry.subindex): c for c in executor.reads}
    random_ = random.Random(6)
    for turn in range(rounds):
        raw = [raw_value(c, random_, turn) for c in executor.writes]
        values = to_write(executor, raw)
        expected = {
            wired[1 - c.slave, c.entry.subindex].field: physical(
                wired[1 - c.slave, c.entry.subindex], value
            )
            for c, value in zip(executor.writes, raw, strict=True)
        }

        def there(answer: Answer, expected: dict[str, float] = expected) -> bool:
            return all(answer.valid) and answer.values == pytest.approx(expected, rel=1e-12)

        answer = until(executor, values, there)
        assert executor.sample(values).cycle > answer.cycle
        check_reached(executor, simulator, raw)


def until(
    executor: Executor, values: Sequence[float], condition: Callable[[Answer], bool]
) -> Answer:
    deadline = time.monotonic() + PATIENCE
    while not condition(answer := executor.sample(values)):
        assert time.monotonic() < deadline, answer
    return answer


@pytest.mark.bus
def test_all_data_types_and_scales(
    compiler: str, typed: Daemon, types: Path, tmp_path: Path
) -> None:
    header = header_of(types)
    assert check_same_calls(types) == 2
    scaled = {
        c.entry.subindex: (c.entry.scale, c.entry.offset)
        for c in connectors(header, outputs=True) + connectors(header, outputs=False)
        if (c.entry.scale, c.entry.offset) != (1, 0)
    }
    assert scaled == SCALED
    with (
        executing(compiler, types, tmp_path, typed.bus) as executor,
        Simulator(str(typed.child_pid("ecatsim"))) as simulator,
    ):
        check_types(executor, simulator)
        assert executor.end() == (0, "")


def calls_in(header: str) -> list[str]:
    """One line of each kind of call in the functions of the blocks: the last one."""
    lines = [line for line in header.splitlines() if re.search(r"  .*\becatm_\w+\(", line)]
    kinds = {re.findall(r"ecatm_\w+", line)[0]: line for line in lines if line.endswith(";")}
    return [
        line for kind, line in kinds.items() if not kind.endswith("_close") and "domain" not in kind
    ]


@pytest.mark.long
@pytest.mark.bus
def test_a_call_that_is_left_out_is_noticed(
    compiler: str,
    typed: Daemon,
    types: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    header = header_of(types)
    source = program(header)
    calls = calls_in(header)
    assert len(calls) == 9, calls  # open, state, three reads, three writes, commit
    monkeypatch.setitem(globals(), "PATIENCE", 0.5)
    with Simulator(str(typed.child_pid("ecatsim"))) as simulator:
        for number, call in enumerate(calls):
            *before, after = header.split(f"\n{call}\n")
            (tmp_path / f"{number}").mkdir()
            (tmp_path / f"{number}" / "Plant.h").write_text(
                f"\n{call}\n".join(before) + "\n" + after
            )
            executable = compile_program(
                *(compiler, source, types, tmp_path),
                *("-I", str(tmp_path / f"{number}"), "-Wno-unused-parameter", "-O0"),
            )
            executor = Executor(executable, header, typed.bus)
            try:
                check_types(executor, simulator, rounds=2)
            except (AssertionError, BrokenPipeError):
                executor.close()
            else:
                pytest.fail(f"is not missed: {call}")


class Witness:
    """The Python client, which writes down what is read in each cycle."""

    def __init__(self, daemon: Daemon, reads: Sequence[Connector]) -> None:
        self.seen: dict[int, list[float]] = {}
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, args=(daemon, reads))

    def __enter__(self) -> "Witness":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _watch(self, daemon: Daemon, reads: Sequence[Connector]) -> None:
        with daemon.client() as client:
            signals = [client.signal(c.slave, c.entry.index, c.entry.subindex, 0) for c in reads]
            while not self._over.is_set():
                client.sample()
                values = [signal.raw for signal in signals]
                self.seen[client.domain(0).cycle] = values


@pytest.mark.bus
def test_the_reference_plant(compiler: str, troll: Daemon, tmp_path: Path) -> None:
    troll.ctl("generate", "Plant", str(tmp_path / "out"))
    assert check_same_calls(tmp_path / "out") == 8
    with (
        executing(compiler, tmp_path / "out", tmp_path, troll.bus) as executor,
        Witness(troll, executor.reads) as witness,
        Simulator(str(troll.child_pid("ecatsim"))) as simulator,
    ):
        random_ = random.Random(5)
        raw = [0.0 if c.entry.index == 0x6040 else raw_value(c, random_) for c in executor.writes]
        values = to_write(executor, raw)
        answers = {}
        for _ in itertools.count():
            answer = executor.sample(values)
            answers[answer.cycle] = answer
            both = set(answers) & set(witness.seen)
            if len(both) >= 50 and all(answer.valid):
                break
        check_reached(executor, simulator, raw)
        assert executor.end() == (0, "")
    # Only now: to compare takes longer than a lease lasts on a busy machine.
    for cycle in both:
        read = zip(executor.reads, witness.seen[cycle], strict=True)
        expected = {c.field: physical(c, value) for c, value in read}
        assert answers[cycle].values == pytest.approx(expected, rel=1e-12)
    assert len({tuple(answers[cycle].values.values()) for cycle in both}) > 10
