"""Plays an FMU with FMPy: variables by name, and what the FMU says."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import fmpy
import fmpy.logging
import pytest
from fmpy import fmi2, fmi3

from conftest import Daemon

OK, WARNING, DISCARD, ERROR = range(4)
STEP = 0.001


class Model:
    """An FMU that is unpacked, of which there may be many instances."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.description = fmpy.read_model_description(str(path))
        self.folder = Path(fmpy.extract(str(path), str(path.with_suffix(""))))
        self.variables = {item.name: item for item in self.description.modelVariables}
        self.fmi = int(self.description.fmiVersion[0])

    @property
    def token(self) -> str:
        if self.fmi == 2:
            return str(self.description.guid)
        return str(self.description.instantiationToken)

    def play(self, **start: Any) -> Player:
        """An instance that has been initialized, after these parameters were set."""
        player = Player(self)
        for name, value in start.items():
            player.set(name, value)
        player.start()
        return player


class Player:
    """One instance. Calls that do not succeed raise an exception.

    Attributes:
        said: Status and text of each message.
    """

    def __init__(
        self,
        model: Model,
        token: str | None = None,
        folder: Path | None = None,
        *,
        event_mode: bool = False,
    ) -> None:
        self.model = model
        self.said: list[tuple[int, str]] = []
        self.time = 0.0
        make = fmi2.FMU2Slave if model.fmi == 2 else fmi3.FMU3Slave
        self.fmu: Any = make(
            guid=model.token if token is None else token,
            unzipDirectory=str(folder or model.folder),
            modelIdentifier=model.description.coSimulation.modelIdentifier,
            instanceName="plant",
        )
        self.alive = False
        if model.fmi == 2:
            self._callbacks = fmi2.fmi2CallbackFunctions()
            self._callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(self._hear2)
            fmpy.logging.addLoggerProxy(ctypes.byref(self._callbacks))
            self.fmu.instantiate(callbacks=self._callbacks, loggingOn=True)
        else:
            self.fmu.instantiate(logMessage=self._hear3, loggingOn=True, eventModeUsed=event_mode)
        self.alive = True

    def _hear2(self, _env: Any, _name: bytes, status: int, _category: bytes, text: bytes) -> None:
        self.said.append((status, text.decode()))

    def _hear3(self, _env: Any, status: int, _category: bytes, text: bytes) -> None:
        self.said.append((status, text.decode()))

    def start(self) -> None:
        if self.model.fmi == 2:
            self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def _call(self, verb: str, name: str) -> tuple[Callable[..., Any], int]:
        variable = self.model.variables[name]
        kind = variable.type
        if kind == "Enumeration":
            kind = "Integer" if self.model.fmi == 2 else "Int64"
        return getattr(self.fmu, verb + kind), variable.valueReference

    def get(self, name: str) -> Any:
        function, reference = self._call("get", name)
        (value,) = function([reference])
        return value

    def set(self, name: str, value: Any) -> None:
        function, reference = self._call("set", name)
        function([reference], [value])

    def step(self, length: float = STEP) -> bool:
        """Makes a step, and returns whether there is an event after it (FMI 3.0)."""
        done = self.fmu.doStep(currentCommunicationPoint=self.time, communicationStepSize=length)
        self.time += length
        return self.model.fmi == 3 and bool(done[0])

    def steps(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP)):
            self.step()

    def errors(self) -> list[str]:
        return [text for status, text in self.said if status >= DISCARD]

    def warnings(self) -> list[str]:
        return [text for status, text in self.said if status == WARNING]

    def free(self) -> None:
        if self.alive:
            self.alive = False
            self.fmu.freeInstance()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.free()


def plant_of(troll: Daemon, folder: Path, fmi: int) -> Model:
    """The FMU of the rig, as the command line makes it."""
    said = troll.ctl("generate", "TrollPlant", str(folder), "--fmu", "--fmi", str(fmi)).stdout
    assert said.startswith(f"{folder}/TrollPlant.fmu: FMI {fmi}.0, 8 slaves, 14 inputs, ")
    return Model(folder / "TrollPlant.fmu")


def outputs(daemon: Daemon) -> list[float]:
    """What the bus of the rig `troll` sends to the eight digital outputs of slave 3."""
    with daemon.client() as client:
        client.sample()
        return [float(entry.raw) for entry in client.signals(3)]


def until(player: Player, condition: Callable[[], bool], seconds: float = 120) -> None:
    """Makes steps until something has come about."""
    for _ in range(round(seconds / STEP)):
        if condition():
            return
        player.step()
    pytest.fail(f"it does not come about; the FMU has said {player.said}")


BEAR: dict[str, Any] = {"lease": 30.0, "whenFailed": 3}
"""Parameters with which a busy machine, on which a step comes too late, does no harm."""
