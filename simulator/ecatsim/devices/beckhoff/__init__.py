"""Beckhoff couplers and terminals, with identities, names and PDOs as in their SII."""

from .analog_inputs import EL3008, EL3102
from .analog_outputs import EL4004, EL4008
from .communication import EL6751
from .couplers import EK1100, EK1122
from .digital import EL1008, EL1018, EL2004, EL2008

__all__ = [
    "EK1100",
    "EK1122",
    "EL1008",
    "EL1018",
    "EL2004",
    "EL2008",
    "EL3008",
    "EL3102",
    "EL4004",
    "EL4008",
    "EL6751",
]
