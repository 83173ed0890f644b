"""Two axes by the FMU of the bus: they home, move together, and stop.

    ecatd --simulate two-axes --config examples/two-axes/two-axes.toml
    ecatctl generate Plant . --fmu
    python examples/two-axes/two_axes_fmu.py Plant.fmu ecat0 >two_axes.csv

Prints time in s, position of x in m, and of y in rad. Any importer of FMI 2.0 does it in this way:
the references are those of each step, so the program makes the way itself.
"""

import sys
from collections.abc import Callable, Iterator
from typing import Any

from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave

STEP, PATIENCE = 0.001, 60.0
OUT, BACK = (0.05, 2.0), (0.0, 0.0)
SPEED, ACCELERATION = 1.0, 4.0  # of the way from 0 to 1 that both axes go


class Plant:
    """The FMU, with its variables by name."""

    def __init__(self, file: str, bus: str) -> None:
        description = read_model_description(file)
        self._references = {item.name: item.valueReference for item in description.modelVariables}
        self._types = {
            item.name: "Integer" if item.type == "Enumeration" else item.type
            for item in description.modelVariables
        }
        self._fmu = FMU2Slave(
            guid=description.guid,
            unzipDirectory=extract(file),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="plant",
        )
        self._fmu.instantiate()
        self._fmu.setString([self._references["bus"]], [bus])
        self._fmu.setupExperiment(startTime=0.0)
        self._fmu.enterInitializationMode()
        self._fmu.exitInitializationMode()
        self.time = 0.0

    def set(self, name: str, value: Any) -> None:
        """Sets a variable."""
        getattr(self._fmu, f"set{self._types[name]}")([self._references[name]], [value])

    def get(self, name: str) -> Any:
        """The value of a variable."""
        (value,) = getattr(self._fmu, f"get{self._types[name]}")([self._references[name]])
        return value

    def both(self, name: str, value: Any) -> None:
        """Sets a variable of both drives."""
        for axis in "xy":
            self.set(f"{axis}.drive.{name}", value)

    def step(self) -> None:
        """A step, which waits for the bus cycle."""
        self._fmu.doStep(currentCommunicationPoint=self.time, communicationStepSize=STEP)
        self.time += STEP

    def until(self, condition: Callable[[], bool]) -> None:
        """Steps until something is so."""
        end = self.time + PATIENCE
        while not condition():
            if self.time > end:
                sys.exit(f"the axes do not get there: states {self.states()}")
            self.step()

    def all(self, name: str) -> bool:
        """Whether it is so of both drives."""
        return all(self.get(f"{axis}.drive.{name}") for axis in "xy")

    def states(self) -> list[int]:
        """The states of both drives."""
        return [self.get(f"{axis}.drive.state") for axis in "xy"]

    def end(self) -> None:
        """Ends it: the outputs are safe."""
        self._fmu.terminate()
        self._fmu.freeInstance()


def way() -> Iterator[float]:
    """The way from 0 to 1 in steps: a trapezoid of the speed."""
    ramp = SPEED / ACCELERATION
    end = 1 / SPEED + ramp
    for number in range(round(end / STEP) + 1):
        time = min(number * STEP, end)
        if time < ramp:
            yield ACCELERATION * time**2 / 2
        elif time < end - ramp:
            yield SPEED * (time - ramp / 2)
        else:
            yield 1 - ACCELERATION * (end - time) ** 2 / 2


def move(plant: Plant, begin: tuple[float, float], goal: tuple[float, float], start: float) -> None:
    """Moves both axes, and prints where they are meanwhile."""
    for part in way():
        for axis, a, b in zip("xy", begin, goal, strict=True):
            plant.set(f"{axis}.drive.positionReference", a + part * (b - a))
        plant.step()
        x, y = (plant.get(f"{axis}.drive.position") for axis in "xy")
        print(f"{plant.time - start:.3f},{x:.6f},{y:.6f}")
    plant.until(lambda: plant.all("reached"))


def main(file: str, bus: str) -> None:
    """The whole movement."""
    plant = Plant(file, bus)
    plant.both("enable", True)
    plant.until(lambda: plant.all("enabled"))
    plant.both("home", True)
    plant.until(lambda: plant.all("homed"))
    plant.both("home", False)
    plant.until(lambda: plant.all("enabled"))
    plant.step()
    plant.until(lambda: plant.all("reached"))
    start = plant.time
    move(plant, BACK, OUT, start)
    move(plant, OUT, BACK, start)
    plant.both("quickStop", True)
    plant.until(lambda: all(state != 5 for state in plant.states()))
    plant.end()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2] if len(sys.argv) > 2 else "ecat0")
