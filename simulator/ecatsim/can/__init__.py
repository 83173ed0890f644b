"""A CAN bus behind simulated terminals: the bus in C, and nodes in Python."""

from .bus import BusStatus, CanBus, NodeState, NodeStatus, Stuck
from .frame import CanFrame, Filter
from .node import CanNode
from .traffic import CheckStatus, Traffic

__all__ = [
    "BusStatus",
    "CanBus",
    "CanFrame",
    "CanNode",
    "CheckStatus",
    "Filter",
    "NodeState",
    "NodeStatus",
    "Stuck",
    "Traffic",
]
