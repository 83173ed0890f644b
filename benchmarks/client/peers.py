"""What others do in the step of a model, where it can be measured."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

from ecatd.model.errors import StateError

from .. import native
from ..engine.exchange import buckets
from ..engine.turns import PYSOEM, Tools, on_line
from ..histogram import quantile
from ..segment.peers import on
from .plant import Plant

SOURCES = "DEVICE_DRIVERS"
"""Environment variable: a checkout of github.com/modelica-3rdparty/Modelica_DeviceDrivers."""
_HEADERS = Path("Modelica_DeviceDrivers") / "Resources" / "Include"


def measure(plant: Plant, slaves: int, size: int, seconds: float) -> dict[str, Any]:
    """The master in the process of the model, and the shared memory of Modelica_DeviceDrivers."""
    return {
        "in_process": _in_process(plant, slaves, size, seconds),
        "device_drivers": _device_drivers(plant, seconds),
    }


def _in_process(plant: Plant, slaves: int, size: int, seconds: float) -> dict[str, Any]:
    """SOEM exchanges in every step, in the thread of the model."""
    with on_line(Tools.make(plant.folder), slaves, size) as turns:
        if not turns.has(PYSOEM):
            return {"reason": turns.missing[PYSOEM]}
        found = turns.run(PYSOEM, rate=0, seconds=seconds)
    return {
        "step": round(quantile(buckets(found), 0.5)),
        "sleeps": round(found["sleeps"] / found["cycles"], 2),
    }


def _device_drivers(plant: Plant, seconds: float) -> dict[str, Any]:
    if SOURCES not in os.environ:
        return {"reason": f"{SOURCES} names no checkout of it"}
    headers = Path(os.environ[SOURCES]) / _HEADERS
    if not (headers / "MDDSharedMemory.h").exists():
        raise StateError(f"{SOURCES}: there is no {headers / 'MDDSharedMemory.h'}")
    program = native.build(plant.folder, "device_drivers", "-isystem", str(headers))
    result = subprocess.run(
        [program, plant.bus, str(seconds)],
        stdout=subprocess.PIPE,
        check=True,
        preexec_fn=on(plant.processors.rest),
    )
    found: dict[str, Any] = json.loads(result.stdout)
    return found
