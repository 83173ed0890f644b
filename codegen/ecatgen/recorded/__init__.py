"""Recorded values as a Modelica block, beside the table file that it reads.

`variables` gives the values the names, types and units that they have in the library and the FMU of
the bus; `block` makes the block of them.
"""

from .block import RecordedBlock, render_block
from .variables import (
    RecordedEntry,
    Variable,
    cycle_variable,
    modelica_names,
    valid_variable,
    variables,
)

__all__ = [
    "RecordedBlock",
    "RecordedEntry",
    "Variable",
    "cycle_variable",
    "modelica_names",
    "render_block",
    "valid_variable",
    "variables",
]
