"""Connects an FMU (co-simulation, FMI 2.0 or 3.0) to simulated slaves, as a plant.

    from ecatsim.plants.fmu import Connection, add_fmu

    add_fmu(rig, "tank.fmu", [
        Connection("pump", (outputs, 0x7000, 1)),       # an input of the FMU: from the slave
        Connection("level", (inputs, 0x6000, 0x11)),    # an output of the FMU: to the slave
    ], start={"area": 0.5}, period=0.001)

FMPy, which loads and calls the FMU, is installed with `pip install ecatd[fmu]`.
"""

from __future__ import annotations

import contextlib
import shutil
import sys
import time
import zipfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ecatd.base.close_names import did_you_mean
from ecatd.base.errors import ConfigError, EcatError, StateError, UsageError
from ecatd.etg.scaling import to_physical

from ..rig import Rig
from .point import Point, Terminal

Start = Mapping[str, float | int | bool | str]
"""Start values of an FMU by the names of its variables."""

_INTO = ("input", "parameter", "structuralParameter")
_OUT_OF = ("output", "local", "calculatedParameter")
_SLOW_STEPS = 1000  # consecutive steps longer than the period that cause a warning


@dataclass(frozen=True, slots=True)
class Connection:
    """Connects a variable of an FMU with a PDO entry of a device.

    The direction follows from the variable. An input or parameter of the FMU becomes
    entry * scale + offset. An output or local variable sets the entry to variable * scale + offset.
    The value of an entry is in its unit, which is volts at analog terminals.

    Attributes:
        variable: Name of the variable.
        terminal: Device, index and subindex.
        scale: See above.
        offset: See above.
    """

    variable: str
    terminal: Terminal
    scale: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, slots=True)
class Cost:
    """Durations of the steps of an FMU.

    Attributes:
        steps: Number of steps.
        mean: Mean time of a step in seconds.
        worst: Longest step in seconds.
    """

    steps: int
    mean: float
    worst: float


def add_fmu(
    rig: Rig,
    path: Path | str,
    connections: Iterable[Connection],
    start: Start | None = None,
    period: float = 0.001,
) -> FmuPlant:
    """Loads an FMU and adds it to a rig; see `FmuPlant`."""
    plant = FmuPlant(path, connections, start, period)
    rig.add_plant(plant, period)
    return plant


class _Group:
    """Variables of one type that are read or written together."""

    def __init__(self, access: Callable[..., Any], convert: Callable[[float], Any]) -> None:
        self.access = access
        self.convert = convert
        self.references: list[int] = []
        self.links: list[tuple[Point, float, float]] = []


class FmuPlant:
    """An FMU that makes one communication step for each call.

    Args:
        path: File of the FMU.
        connections: The variables and their entries.
        start: Start values, set before the initialization.
        period: Communication step size in seconds.

    Raises:
        ConfigError: The file cannot be used, or has no such variable.
        UsageError: FMPy is not installed, or a device has no such entry.
    """

    def __init__(
        self,
        path: Path | str,
        connections: Iterable[Connection],
        start: Start | None = None,
        period: float = 0.001,
    ) -> None:
        self._path = Path(path)
        self._period = period
        self._number = self._slow = 0
        self._total = self._worst = 0.0
        self._message = ""
        self._fmu: Any = None
        self._folder: str | None = None
        fmpy = _fmpy()
        self._description = _read(fmpy, self._path)
        self._variables = {item.name: item for item in self._description.modelVariables}
        plan = [(self._variable(item.variable), item) for item in connections]
        values = [(self._variable(name), value) for name, value in (start or {}).items()]
        points = [Point(item.terminal) for _, item in plan]
        self._inputs: dict[str, _Group] = {}
        self._outputs: dict[str, _Group] = {}
        try:
            self._load(fmpy)
            for (variable, item), point in zip(plan, points, strict=True):
                self._connect(variable, item, point)
            self._begin(values)
        except Exception as error:
            self.close()
            raise self._failed("it could not be started", error) from error

    def __call__(self, now: float) -> None:
        """Makes a step: inputs from the devices, the FMU, outputs to the devices.

        Raises:
            StateError: The FMU reported an error.
        """
        del now  # the time of the FMU counts from 0, one period per step
        begin = time.perf_counter()
        try:
            self._step()
        except Exception as error:
            at = self._number * self._period
            raise self._failed(f"its step at {at:.6g} s failed", error) from error
        self._count(time.perf_counter() - begin)

    def close(self) -> None:
        """Ends the FMU and removes its unpacked files."""
        fmu, self._fmu = self._fmu, None
        if fmu is not None:
            for end in (fmu.terminate, fmu.freeInstance):
                with contextlib.suppress(Exception):  # errors no longer matter
                    end()
        if self._folder:
            shutil.rmtree(self._folder, ignore_errors=True)
            self._folder = None

    def __del__(self) -> None:
        if getattr(self, "_folder", None):
            self.close()

    @property
    def cost(self) -> Cost:
        """Duration of the steps so far, including the access to variables."""
        return Cost(self._number, self._total / max(1, self._number), self._worst)

    # --- start ---------------------------------------------------------------------------------

    def _load(self, fmpy: Any) -> None:
        from fmpy.simulation import instantiate_fmu

        self._folder = fmpy.extract(str(self._path))
        self._fmu = instantiate_fmu(
            self._folder, self._description, "CoSimulation", logger=self._keep_message
        )

    def _begin(self, values: Sequence[tuple[Any, float | int | bool | str]]) -> None:
        fmu = self._fmu
        if self._is_fmi2:
            fmu.setupExperiment(startTime=0.0)
        for variable, value in values:
            kind, convert = self._kind(variable)
            getattr(fmu, f"set{kind}")([variable.valueReference], [convert(value)])
        if self._is_fmi2:
            fmu.enterInitializationMode()
        else:
            fmu.enterInitializationMode(startTime=0.0)
        fmu.exitInitializationMode()

    def _keep_message(self, *arguments: Any) -> None:
        """Keeps the last message of the FMU for error messages."""
        text = arguments[-1]
        self._message = (text.decode("utf-8", "replace") if isinstance(text, bytes) else "").strip()

    def _failed(self, what: str, error: Exception) -> Exception:
        if isinstance(error, EcatError):
            return error
        reason = " ".join(str(error).split()).rstrip(".") or type(error).__name__
        said = f"; it says: {' '.join(self._message.split())}" if self._message else ""
        return StateError(f"{self._path}: {what}: {reason}{said}")

    # --- variables -----------------------------------------------------------------------------

    @property
    def _is_fmi2(self) -> bool:
        return str(self._description.fmiVersion).startswith("2.")

    def _variable(self, name: str) -> Any:
        """Finds a variable of the FMU, which must be a single number.

        Raises:
            ConfigError: There is no such variable.
        """
        variable = self._variables.get(name)
        if variable is None:
            hint = did_you_mean(name, self._variables, most=3, cutoff=0.5) or self._connectable()
            raise ConfigError(f"{self._path}: the FMU has no variable '{name}': {hint}")
        if variable.type in ("String", "Binary", "Clock") or getattr(variable, "shape", None):
            raise ConfigError(f"{self._path}: variable '{name}' is not a single number")
        return variable

    def _connectable(self) -> str:
        names = [
            item.name
            for item in self._description.modelVariables
            if item.causality in ("input", "output")
        ]
        return f"its inputs and outputs are {', '.join(names) or 'none'}"

    def _kind(self, variable: Any) -> tuple[str, Callable[[Any], Any]]:
        """Returns the type in the names of get and set functions, and the conversion to it."""
        kind = variable.type
        if kind == "Enumeration":
            return ("Integer" if self._is_fmi2 else "Int64"), round
        if kind == "Boolean":
            return kind, lambda value: bool(value >= 0.5)
        return kind, float if kind in ("Real", "Float64", "Float32") else round

    def _connect(self, variable: Any, item: Connection, point: Point) -> None:
        kind, convert = self._kind(variable)
        if variable.causality in _INTO:
            groups, access = self._inputs, f"set{kind}"
        elif variable.causality in _OUT_OF:
            groups, access = self._outputs, f"get{kind}"
        else:
            raise ConfigError(
                f"{self._path}: variable '{item.variable}' is of causality "
                f"{variable.causality}, which cannot be connected"
            )
        group = groups.setdefault(access, _Group(getattr(self._fmu, access), convert))
        group.references.append(variable.valueReference)
        group.links.append((point, item.scale, item.offset))

    # --- steps ---------------------------------------------------------------------------------

    def _step(self) -> None:
        for group in self._inputs.values():
            group.access(
                group.references,
                [
                    group.convert(to_physical(p.get(), scale, offset))
                    for p, scale, offset in group.links
                ],
            )
        result = self._fmu.doStep(self._number * self._period, self._period)
        if isinstance(result, tuple) and result[1]:  # FMI 3.0: terminateSimulation
            raise StateError(f"{self._path}: the FMU asks to end the simulation")
        for group in self._outputs.values():
            values = group.access(group.references)
            for value, (point, scale, offset) in zip(values, group.links, strict=True):
                point.set(to_physical(value, scale, offset))

    def _count(self, took: float) -> None:
        self._number += 1
        self._total += took
        self._worst = max(self._worst, took)
        self._slow = self._slow + 1 if took > self._period else 0
        if self._slow == _SLOW_STEPS:
            print(
                f"ecatsim: {self._path}: a step of {self._period * 1000:g} ms takes "
                f"{took * 1000:.3g} ms, so the plant cannot keep up: give it a longer period",
                file=sys.stderr,
            )


def _fmpy() -> Any:
    try:
        import fmpy
    except ImportError:
        raise UsageError("an FMU as a plant needs FMPy: pip install 'ecatd[fmu]'") from None
    return fmpy


def _read(fmpy: Any, path: Path) -> Any:
    """Reads the model description.

    Raises:
        ConfigError: The file is missing, is not an FMU, or is an FMU that cannot be used here.
    """
    if not path.is_file():
        raise ConfigError(f"there is no FMU '{path}'")
    try:
        description = fmpy.read_model_description(str(path))
        platforms = fmpy.supported_platforms(str(path))
    except (zipfile.BadZipFile, KeyError) as error:
        raise ConfigError(f"{path}: this is not an FMU: {' '.join(str(error).split())}") from error
    except Exception as error:
        raise ConfigError(f"{path}: FMPy refuses it: {' '.join(str(error).split())}") from error
    version = str(description.fmiVersion)
    if not version.startswith(("2.", "3.")):
        raise ConfigError(f"{path}: FMI {version} is not supported: export it for FMI 2.0 or 3.0")
    if description.coSimulation is None:
        raise ConfigError(f"{path}: this FMU has no co-simulation: export it with co-simulation")
    if fmpy.platform not in platforms:
        found = ", ".join(platforms) or "none"
        raise ConfigError(f"{path}: it has no binary for {fmpy.platform}, only for {found}")
    return description
