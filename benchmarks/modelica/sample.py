"""One sample of a model: all blocks of a bus read and write."""

from __future__ import annotations

import re
import shutil
import subprocess
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ecatd.model.errors import StateError
from ecatgen import generate

from .. import native
from ..client.plant import CYCLE_US, Plant
from ..machine import Processors
from ..segment import cells

SIZE = 8
"""Bytes of outputs, and of inputs, of each slave: two values of 32 bits each."""
_LIBRARY = "Bench"
_FEW, _MANY = 1_000, 21_000
_SAMPLE_TIME = 0.001


def measure(
    folder: Path, slaves: Sequence[int], seconds: float, say: Callable[[str], None]
) -> list[dict[str, Any]]:
    """A sample through the blocks, beside plain calls of the client, for so many slaves.

    Args:
        folder: For libraries and programs.
        slaves: Numbers of slaves.
        seconds: How long each is measured.
        say: Told what is going on.
    """
    result = []
    for count in slaves:
        say(f"a sample of {count} slaves")
        plant = _plant(folder, count)
        with plant.line(count, SIZE) as line, line.exchanged():
            result.append({"slaves": count, **plant.run("model", seconds)})
    return result


def _plant(folder: Path, count: int) -> Plant:
    out = folder / f"model{count}"
    bus = cells.bus(f"bench{count}", count, SIZE, CYCLE_US)
    generate(bus, _LIBRARY, out)
    resources = out / "EtherCAT" / "Resources"
    (archive,) = (resources / "Library").rglob("libecat.a")
    include = (
        resources / "Include",
        resources / "Source" / "standalone",
        out / _LIBRARY / "Resources" / "Source",
    )
    flags = [f"-I{path}" for path in include]
    return Plant(
        Processors.plan(), out, {"model": native.build(out, "model", *flags, str(archive), "-lm")}
    )


def translated(folder: Path, slaves: Sequence[int], say: Callable[[str], None]) -> dict[str, Any]:
    """The same by a model with all blocks that OpenModelica has translated, free-running.

    Args:
        folder: Of `measure`, with its libraries.
        slaves: Numbers of slaves, of those of `measure`.
        say: Told what is going on.
    """
    if slaves and shutil.which("omc") is None:
        return {"reason": "OpenModelica (omc) is not on PATH"}
    cases = []
    for count in slaves:
        say(f"a model of {count} slaves in OpenModelica")
        plant = _plant(folder, count)
        program = _translate(plant.folder, plant.bus, count)
        with plant.line(count, SIZE) as line, line.exchanged():
            few, many = (_run(program, samples) for samples in (_FEW, _MANY))
        cases.append({"slaves": count, "sample": round((many - few) / (_MANY - _FEW) * 1e9)})
    return {"cases": cases}


def _translate(folder: Path, bus: str, count: int) -> Path:
    """The program of a model in which every output has a constant."""
    blocks = [f"Cell_{n}" if n > 1 else "Cell" for n in range(1, count + 1)]
    source = (folder / _LIBRARY / "Cell.mo").read_text()
    outputs = re.findall(r"RealInput (\w+)", source)
    lines = [
        "model Whole",
        f'  inner EtherCAT.EtherCATMaster etherCATMaster(bus = "{bus}", lease = 0.5);',
        *(f"  {_LIBRARY}.{block} {block.lower()};" for block in blocks),
        "equation",
        *(f"  {block.lower()}.{output} = 1;" for block in blocks for output in outputs),
        "end Whole;",
    ]
    (folder / "Whole.mo").write_text("\n".join(lines) + "\n")
    script = folder / "translate.mos"
    script.write_text(
        'loadModel(Modelica, {"4.0.0"});\n'
        f'loadFile("{folder}/EtherCAT/package.mo");\nloadFile("{folder}/{_LIBRARY}/package.mo");\n'
        f'loadFile("{folder}/Whole.mo");\nbuildModel(Whole, outputFormat = "empty");\n'
        "getErrorString();\n"
    )
    done = subprocess.run(["omc", script], cwd=folder, capture_output=True, text=True, check=False)
    if not (folder / "Whole").exists():
        raise StateError(f"OpenModelica has not translated the model: {done.stdout[-800:]}")
    return folder / "Whole"


def _run(program: Path, samples: int) -> float:
    """Seconds that the model needs for so many samples, with its start and its end."""
    end = samples * _SAMPLE_TIME
    start = time.perf_counter()
    done = subprocess.run(
        [program, f"-override=stopTime={end},stepSize={end}", "-noEventEmit"],
        cwd=program.parent,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise StateError(f"the model has failed: {(done.stdout + done.stderr)[-800:]}")
    return time.perf_counter() - start
