"""The calls of generated blocks, as the blocks and as the header for C have them.

And a program that makes them, with all values from outside.
"""

from __future__ import annotations

import contextlib
import re
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

LIBRARY = "Plant"

_MO_PDO = re.compile(
    r"parameter EtherCAT\.Objects\.PDO (\w+) = EtherCAT\.Objects\.PDO\(\s*slaveConfiguration, "
    r"(\d+), (\d+), (true|false), (\d+), (\d+)(?:, (\S+), (\S+), \"(.*)\")?\) \""
)
_MO_READ = re.compile(r"(\w+) = EtherCAT\.Functions\.read(\w+)\((\w+), time, (\S+)\);")
_MO_WRITE = re.compile(r"(\w+) = EtherCAT\.Functions\.write(\w+)\((\w+), time, (\S+), (\w+)\);\n")
_MO_COMMIT = re.compile(r"EtherCAT\.Functions\.commit\(slaveConfiguration, time, (\w+)\);")
_MO_SLAVE = re.compile(
    r"position = (\S+),\s+(?:name = \"(.*)\",\s+)?vendorID = (.+?),\s+productCode = (.+?),\s+"
    r"revisionNumber = (.+?)\),\s"
)
_H_SLAVE = re.compile(r"ecatm_slave_open\(block->domain, (.+?), \"(.*?)\", (.+?), (.+?), (.+?),\n")
_H_PDO = re.compile(
    r"block->(\w+) = ecatm_pdo_open\(block->slave, (\w+), (\d+), ([01]), (\d+), (\d+), (\S+), "
    r"(\S+), \"(.*)\"\);"
)
_H_READ = re.compile(r"block->(\w+) = ecatm_read_(\w+)\(block->(\w+), time, cycle\);")
_H_WRITE = re.compile(r"cycle = ecatm_write_(\w+)\(block->(\w+), time, cycle, block->(\w+)\);")
_H_COMMIT = "ecatm_commit(block->slave, time, cycle);"
_H_BLOCK = re.compile(
    rf"typedef struct {LIBRARY}_(\w+) {{(.*?)\n(?=typedef struct|/\* All blocks|\n/\* )", re.DOTALL
)
_H_INSTANCE = re.compile(rf"^  {LIBRARY}_(\w+) (\w+);$", re.MULTILINE)


def _instances(header: str) -> dict[str, str]:
    """Names of the components of all blocks, by class."""
    return dict(_H_INSTANCE.findall(header.split("/* All blocks of the library. */")[1]))


@dataclass(frozen=True)
class Entry:
    """A PDO entry, as its constructor has it."""

    index: int
    subindex: int
    output: bool
    data_type: int
    bits: int
    scale: float
    offset: float
    unit: str


@dataclass(frozen=True)
class Calls:
    """What a block calls, in its order.

    Attributes:
        slave: Position, vendor, product and revision.
        opened: Handles, and the entries that they are opened for.
        reads: Connector, kind and handle.
        writes: The same.
        commits: Whether a commit follows the writes.
    """

    slave: tuple[str, ...]
    opened: tuple[tuple[str, Entry], ...]
    reads: tuple[tuple[str, str, str], ...]
    writes: tuple[tuple[str, str, str], ...]
    commits: bool


def of_modelica(text: str) -> Calls:
    """The calls of a block; checks that writes and commit are a chain."""
    text = text.split("annotation (\n    defaultComponentName")[0]
    slave = _MO_SLAVE.search(text)
    assert slave is not None
    opened = [
        (handle, _entry(index, subindex, output == "true", *words))
        for handle, index, subindex, output, *words in _MO_PDO.findall(text)
    ]
    reads = _MO_READ.findall(text)
    assert all(after == "etherCATMaster.cycle" for *_, after in reads)
    writes = _MO_WRITE.findall(text)
    last = "etherCATMaster.cycle"
    for written, _, _, after, _ in writes:
        assert after == last
        last = written
    commit = _MO_COMMIT.findall(text)
    assert commit == ([last] if writes else [])
    return Calls(
        tuple(group or "" for group in slave.groups()),
        tuple(opened),
        tuple((name, kind.lower(), handle) for name, kind, handle, _ in reads),
        tuple((name, kind.lower(), handle) for _, kind, handle, _, name in writes),
        bool(commit),
    )


def of_header(text: str) -> dict[str, Calls]:
    """The calls of all blocks, by name."""
    result = {}
    for name, body in _H_BLOCK.findall(text):
        if name.startswith("Drives_"):  # is made of the block of its slave
            continue
        slave = _H_SLAVE.search(body)
        assert slave is not None
        assert body.count("ecatm_slave_state(block->slave, time, cycle, ") == 1
        opened = [
            (handle, _entry(index, subindex, output == "1", *words))
            for handle, index, subindex, output, *words in _H_PDO.findall(body)
        ]
        for handle, _ in opened:
            assert body.count(f"ecatm_pdo_close(block->{handle});") == 1
        result[name] = Calls(
            slave.groups(),
            tuple(opened),
            tuple(_H_READ.findall(body)),
            tuple((name, kind, handle) for kind, handle, name in _H_WRITE.findall(body)),
            _H_COMMIT in body,
        )
    return result


def _entry(index: str, subindex: str, output: bool, *words: str) -> Entry:
    kind, bits, scale, offset, unit = words
    return Entry(
        *(int(index, 0), int(subindex), output, int(kind), int(bits)),
        *(float(scale or 1), float(offset or 0), unit),
    )


@dataclass(frozen=True)
class Connector:
    """A connector of a block in the program.

    Attributes:
        field: Its place in the structure of all blocks.
        slave: Position.
        entry: Its entry.
        kind: boolean, integer or real.
    """

    field: str
    slave: int
    entry: Entry
    kind: str


def connectors(header: str, *, outputs: bool) -> list[Connector]:
    """All connectors that a program writes, or reads, in the order of its calls."""
    instances = _instances(header)
    result = []
    for name, calls in of_header(header).items():
        entries = dict(calls.opened)
        for connector, kind, handle in calls.writes if outputs else calls.reads:
            field = f"{instances[name]}.{connector}"
            result.append(Connector(field, int(calls.slave[0]), entries[handle], kind))
    return result


def program(header: str, sample_time: str = "0.001") -> str:
    """Source of a program that makes the calls of all blocks; argument: the bus.

    Each line of its input has the simulation time and all values to write; it answers with the bus
    cycle, whether each slave is valid and in OP, and all values that were read.
    """
    instances = _instances(header).values()
    write = "".join(
        f'    if (scanf("%lf", &value) != 1) return 9;\n    plant.{c.field} = '
        f"{'' if c.kind == 'real' else '(int)'}value;\n"
        for c in connectors(header, outputs=True)
    )
    show = "".join(
        f'    printf(" %d", plant.{name}.valid && plant.{name}.alState == 6);\n'
        for name in instances
    ) + "".join(
        f'    printf(" %.17g", (double)plant.{c.field});\n'
        for c in connectors(header, outputs=False)
    )
    return f"""
#include "{LIBRARY}.h"
int main(int argc, char **argv) {{
  static {LIBRARY} plant;
  double time, value;
  int cycle;
  void *master = ecatm_master_open(argv[argc - 1], 1, {sample_time}, 1, 30.0, 1, 2, 0, 0, 0, "");
  {LIBRARY}_open(&plant, master, 1);
  while (scanf("%lf", &time) == 1) {{
    cycle = ecatm_wait(master, time);
    {LIBRARY}_read(&plant, time, cycle);
{write}    {LIBRARY}_write(&plant, time, cycle);
    printf("%d", cycle);
{show}    puts("");
    fflush(stdout);
  }}
  {LIBRARY}_close(&plant);
  ecatm_master_close(master);
  (void)value;
  return 0;
}}
"""


@dataclass(frozen=True)
class Answer:
    """What the program says in one sample."""

    cycle: int
    valid: tuple[bool, ...]
    values: Mapping[str, float]


class Executor:
    """The program, running."""

    def __init__(self, executable: Path, header: str, bus: str) -> None:
        self.writes = connectors(header, outputs=True)
        self.reads = connectors(header, outputs=False)
        self._blocks = len(_instances(header))
        self._time = 0.0
        self._process = subprocess.Popen(
            [str(executable), bus],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def sample(self, values: Sequence[float]) -> Answer:
        """One sample with the values of all connectors that are written."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._time += 0.001
        words = " ".join([f"{self._time:.6f}", *(f"{value!r}" for value in values)])
        self._process.stdin.write(words + "\n")
        self._process.stdin.flush()
        answer = self._process.stdout.readline().split()
        assert answer, self.end()
        cycle, valid, rest = answer[0], answer[1 : 1 + self._blocks], answer[1 + self._blocks :]
        return Answer(
            int(cycle),
            tuple(word == "1" for word in valid),
            {c.field: float(word) for c, word in zip(self.reads, rest, strict=True)},
        )

    def end(self) -> tuple[int, str]:
        """Ends it; exit status, and what it has said."""
        _, said = self._process.communicate()
        return self._process.returncode, said

    def close(self) -> None:
        """Ends it, if it still runs."""
        self._process.kill()
        with contextlib.suppress(BrokenPipeError):
            self._process.communicate()
        self._process.wait()
