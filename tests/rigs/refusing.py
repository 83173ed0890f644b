"""Slaves that refuse another PDO assignment: at once, for one direction, or half way."""

from ecatd.base.errors import SdoAbortError
from ecatd.etg.error_codes import READ_ONLY
from ecatsim.devices.generic_drive import CiA402Drive
from ecatsim.rig import Rig
from ecatsim.slave.objects import Value


class AtOnce(CiA402Drive):
    order = "AtOnce"
    variable_assignment = False


class OneDirection(CiA402Drive):
    order = "OneDirection"

    def describe(self) -> None:
        super().describe()
        self.dictionary[0x1C13, 0].on_write = _refuse


class HalfWay(CiA402Drive):
    """It clears its outputs, and then takes none."""

    order = "HalfWay"

    def describe(self) -> None:
        super().describe()
        self.dictionary[0x1C12, 1].on_write = _refuse


def _refuse(_value: Value) -> None:
    raise SdoAbortError(READ_ONLY)


def rig() -> Rig:
    return Rig("refusing", [AtOnce(), OneDirection(), HalfWay()])
