"""One sample of a model, in which all blocks of a bus read and write."""

from __future__ import annotations

import dataclasses
import re
import shutil
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ecatd.base.errors import StateError
from ecatgen import generate

from .. import native
from ..bench import Bench
from ..segment import cells
from ..segment.mirror import CYCLE_US, mirror_line

SIZE = 8
"""Bytes of outputs, and of inputs, of each slave: two values of 32 bits each."""
_LIBRARY = "Bench"
_FEW, _MANY = 1_000, 21_000
_SAMPLE_TIME = 0.001


def measure(bench: Bench, slaves: int, seconds: float) -> dict[str, Any]:
    """Times a sample through the blocks, and the same work in plain calls of the client library."""
    bench.say(f"a sample of {slaves} slaves")
    here = _with_library(bench, slaves)
    with mirror_line(here, slaves, SIZE) as line, line.exchanged():
        return {"slaves": slaves, **here.run("model", here.bus, seconds)}


def _with_library(bench: Bench, slaves: int) -> Bench:
    """Generates a library of some slaves and builds the program `model` with it.

    Returns:
        A copy of `bench` whose folder has both.
    """
    out = bench.folder / f"model{slaves}"
    generate(cells.bus(bench.bus, slaves, SIZE, CYCLE_US), _LIBRARY, out)
    resources = out / "EtherCAT" / "Resources"
    (archive,) = (resources / "Library").rglob("libecat.a")
    include = (
        resources / "Include",
        resources / "Source" / "standalone",
        out / _LIBRARY / "Resources" / "Source",
    )
    native.build(out, "model", *(f"-I{path}" for path in include), str(archive), "-lm")
    return dataclasses.replace(bench, folder=out)


def translated(bench: Bench, slaves: Sequence[int]) -> dict[str, Any]:
    """Times a sample of models with all blocks, translated by OpenModelica.

    The time of a sample is the difference between a long and a short simulation, which both run as
    fast as they can.
    """
    if slaves and shutil.which("omc") is None:
        return {"reason": "OpenModelica (omc) is not on PATH"}
    cases = []
    for count in slaves:
        bench.say(f"a model of {count} slaves in OpenModelica")
        here = _with_library(bench, count)
        program = _translate(here.folder, here.bus, count)
        with mirror_line(here, count, SIZE) as line, line.exchanged():
            few, many = (_run(program, samples) for samples in (_FEW, _MANY))
        cases.append({"slaves": count, "sample": round((many - few) / (_MANY - _FEW) * 1e9)})
    return {"cases": cases}


def _translate(folder: Path, bus: str, count: int) -> Path:
    """Translates a model that sets every output to a constant, and returns its program."""
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
    """Returns the seconds that a simulation of some samples takes, with its start and its end."""
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
