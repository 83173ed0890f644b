"""Faults on demand: what can go wrong on a segment, when, and how often.

Each fault is one class with its parameters. The methods of `Simulation.faults` and
`Simulator.faults`, the commands of `ecatsim ctl`, the tables `[[fault]]` of rig files and the
messages of the control socket are all derived from these classes.
"""

from .fault import Fault, SlaveFault
from .frames import FrameFault
from .schedule import Faults, FaultState
from .table import FAULTS, parse

__all__ = ["FAULTS", "Fault", "FaultState", "Faults", "FrameFault", "SlaveFault", "parse"]
