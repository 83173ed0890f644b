"""Clients of every kind that turn the drive of the rig `troll` until they are killed."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from ecatd.cli.library import static_flags

from .. import native
from ..machine import ROOT

SPEED = 200_000
"""Increments per second of the drive, in all clients."""
INCREMENTS = 65536
"""Of one revolution."""

_PYTHON = """
import contextlib, sys
from ecatd.client import Client
from ecatd.base.errors import UnreachableError
speed, lease = map(float, sys.argv[2:])
with Client(sys.argv[1]) as bus:
    control, mode, target = (bus.signal(0, index) for index in (0x6040, 0x6060, 0x60FF))
    status = bus.signal(0, 0x6041)
    bus.claim(0, lease=lease)
    while True:
        with contextlib.suppress(UnreachableError):
            bus.wait()
            bus.sample()
            mode.raw, target.raw = 9, speed
            control.raw = {0x21: 7, 0x23: 15, 0x27: 15}.get(int(status.raw) & 0x6F, 6)
            bus.commit()
"""
_FMU = """
import sys, fmpy
from fmpy.fmi3 import FMU3Slave
bus, speed, lease, path = sys.argv[1], *map(float, sys.argv[2:4]), sys.argv[4]
description = fmpy.read_model_description(path)
fmu = FMU3Slave(
    guid=description.instantiationToken,
    unzipDirectory=fmpy.extract(path),
    modelIdentifier=description.coSimulation.modelIdentifier,
    instanceName="turning",
)
fmu.instantiate()
variables = {item.name: item for item in description.modelVariables}
def call(verb, name, *values):
    item = variables[name]
    kind = {"Enumeration": "Int64"}.get(item.type, item.type)
    return getattr(fmu, verb + kind)([item.valueReference], *values)
call("set", "bus", [bus])
call("set", "lease", [lease])
call("set", "whenFailed", [3])  # a busy machine exchanges nothing for a while
fmu.enterInitializationMode()
fmu.exitInitializationMode()
drive, time = "goldGCONDrive.", 0.0
call("set", drive + "modeOfOperation", [9])
call("set", drive + "targetVelocity", [int(speed)])
call("set", drive + "maxTorque", [1000])
while True:
    state = call("get", drive + "statusWord")[0] & 0x6F
    call("set", drive + "controlWord", [{0x21: 7, 0x23: 15, 0x27: 15}.get(state, 6)])
    fmu.doStep(currentCommunicationPoint=time, communicationStepSize=0.001)
    time += 0.001
"""

KINDS = ("C", "C, 256 MB", "C, own PID namespace", "C++", "Python", "Modelica calls", "FMU")


def command(
    kind: str, bus: str, lease: float, folder: Path, generate: Callable[..., object]
) -> list[str]:
    """Builds a client of a kind, and returns the command that runs it.

    Args:
        kind: One of `KINDS`.
        bus: Name of the bus.
        lease: Seconds.
        folder: An empty folder for its files.
        generate: Runs `ecatctl generate` with these arguments.
    """
    options = (bus, str(SPEED), str(lease))
    match kind:
        case "Python":
            return [sys.executable, "-c", _PYTHON, *options]
        case "FMU":
            generate("TrollPlant", str(folder), "--fmu", "--fmi", "3")
            return [sys.executable, "-c", _FMU, *options, str(folder / "TrollPlant.fmu")]
        case "C++":
            return [str(_example(folder)), bus, "0", str(SPEED), "100000", str(int(lease * 1000))]
        case "Modelica calls":
            generate("Plant", str(folder))
            angular = str(SPEED / INCREMENTS * 6.283)
            return [str(_blocks(folder)), bus, angular, str(lease)]
        case _:
            program = [str(native.build(folder, "turning", *static_flags())), *options]
            if kind == "C, 256 MB":
                program.append("256")
            return [*_namespace(), *program] if "namespace" in kind else program


def victim(kind: str, process: subprocess.Popen[bytes]) -> int:
    """The process that is to be killed, as this PID namespace numbers it."""
    if "namespace" not in kind:
        return process.pid
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text()
    return int(children.split()[0])


def _namespace() -> Sequence[str]:
    own = () if os.geteuid() == 0 else ("--user", "--map-current-user")
    return ("unshare", *own, "--pid", "--fork", "--kill-child")


def _example(folder: Path) -> Path:
    program = folder / "drive_velocity"
    source = ROOT / "examples" / "clients" / "drive_velocity.cpp"
    subprocess.run(["g++", "-O2", "-std=c++17", source, *static_flags(), "-o", program], check=True)
    return program


def _blocks(folder: Path) -> Path:
    resources = folder / "EtherCAT" / "Resources"
    (archive,) = (resources / "Library").rglob("libecat.a")
    program, source = folder / "blocks", ROOT / "benchmarks" / "c" / "turning.c"
    subprocess.run(
        [
            *("gcc", "-O2", "-DBLOCKS", f"-I{resources / 'Include'}"),
            f"-I{resources / 'Source' / 'standalone'}",
            f"-I{ROOT / 'tests' / 'contract'}",
            *(source, archive, "-lm", "-pthread", "-o", program),
        ],
        check=True,
    )
    return program
