"""The messages of CAN buses behind terminals, from DBC and EDS files, for blocks and FMUs."""

from .memory import FILE, dump, parse, remembered
from .messages import CanFile, CanMessage, CanSignal, Selector
from .options import NONE, Request, parse_option, read_request
from .terminals import on_bus, terminal

__all__ = [
    "FILE",
    "NONE",
    "CanFile",
    "CanMessage",
    "CanSignal",
    "Request",
    "Selector",
    "dump",
    "on_bus",
    "parse",
    "parse_option",
    "read_request",
    "remembered",
    "terminal",
]
