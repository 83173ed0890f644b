"""Drives a motor through the FMU of the plant: a PI controller makes its speed follow a ramp.

    ecatd --simulate troll                             # in another terminal
    ecatctl generate TrollPlant . --fmu
    python speed_loop.py TrollPlant.fmu                # pip install fmpy

Every step of the FMU waits for the next cycle of the bus, so this loop needs no clock of its own.
"""

import argparse
import sys

from fmpy import extract, read_model_description
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave

DRIVE = "goldGCONDrive"
STEP = 0.001  # s: the cycle of the bus
CYCLIC_VELOCITY = 9  # mode of operation (CiA 402)
ENABLED = 0x27  # of the bits 0x6F of the status word


class Plant:
    """The FMU, with variables by name."""

    def __init__(self, path: str, **parameters: object) -> None:
        description = read_model_description(path)
        if description.fmiVersion != "2.0":
            sys.exit(f"{path} has FMI {description.fmiVersion}: make it without --fmi 3")
        self._variables = {item.name: item for item in description.modelVariables}
        self._fmu = FMU2Slave(
            guid=description.guid,
            unzipDirectory=extract(path),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="plant",
        )
        self._fmu.instantiate()
        for name, value in parameters.items():
            self[name] = value
        self._fmu.setupExperiment(startTime=0.0)
        self._fmu.enterInitializationMode()
        self._fmu.exitInitializationMode()
        self.time = 0.0

    def __getitem__(self, name: str) -> float:
        variable = self._variables[name]
        (value,) = getattr(self._fmu, f"get{variable.type}")([variable.valueReference])
        return value

    def __setitem__(self, name: str, value: object) -> None:
        variable = self._variables[name]
        getattr(self._fmu, f"set{variable.type}")([variable.valueReference], [value])

    def step(self) -> None:
        """Writes all inputs to the bus, waits for the next cycle, reads all outputs."""
        self._fmu.doStep(currentCommunicationPoint=self.time, communicationStepSize=STEP)
        self.time += STEP

    def close(self) -> None:
        """Ends the simulation: the outputs of the bus go to their safe values."""
        self._fmu.terminate()
        self._fmu.freeInstance()


def command(status: int) -> int:
    """The control word that leads from this state towards "Operation enabled" (CiA 402)."""
    if status & 0x08:
        return 0x80  # fault reset
    if status & 0x4F == 0x40:
        return 0x06  # shutdown
    return 0x07 if status & 0x6F == 0x21 else 0x0F


def main() -> None:
    """Enables the drive, then follows the ramp."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("fmu", help="made by: ecatctl generate TrollPlant . --fmu")
    parser.add_argument("--bus", default="ecat0", help="name of the bus (default: ecat0)")
    parser.add_argument("--speed", type=float, default=100_000, help="in increments per second")
    options = parser.parse_args()

    plant = Plant(options.fmu, bus=options.bus, lease=0.5)
    plant[f"{DRIVE}.modeOfOperation"] = CYCLIC_VELOCITY
    plant[f"{DRIVE}.maxTorque"] = 1000  # 0.1 % of the rated torque
    plant[f"{DRIVE}.targetVelocity"] = 0
    while int(plant[f"{DRIVE}.statusWord"]) & 0x6F != ENABLED:
        plant[f"{DRIVE}.controlWord"] = command(int(plant[f"{DRIVE}.statusWord"]))
        plant.step()

    begin, integral = plant.time, 0.0
    print("time in s, reference and measured speed in increments per second")
    while plant.time < begin + 2.0:
        reference = options.speed * min(plant.time - begin, 1.0)
        measured = plant[f"{DRIVE}.velocityActualValue"]
        integral += 2.0 * (reference - measured) * STEP
        target = reference + 0.2 * (reference - measured) + integral
        plant[f"{DRIVE}.targetVelocity"] = round(target)
        plant.step()
        if round(plant.time / STEP) % 200 == 0:
            print(f"{plant.time - begin:.1f} {reference:.0f} {measured:.0f}")
    print(f"{int(plant['missed'])} bus cycles passed beside those that the steps waited for")
    plant.close()


if __name__ == "__main__":
    try:
        main()
    except FMICallException:
        sys.exit(1)  # FMPy has printed what the FMU says
