"""The CAN nodes that rig files name."""

from __future__ import annotations

from collections.abc import Mapping

from ecatd.base.close_names import did_you_mean
from ecatd.base.errors import UsageError

from ...devices.parameters import Parameter
from ..node import CanNode
from .drive import CanopenDrive
from .io import CanopenIO
from .sensor import TorqueSensor

NODES: Mapping[str, type[CanNode]] = {
    kind.__name__: kind for kind in (CanopenDrive, CanopenIO, TorqueSensor)
}


def make(name: str, **parameters: object) -> CanNode:
    """Makes a node.

    Args:
        name: Name of its class; upper and lower case are the same.
        **parameters: Parameters of its class.

    Raises:
        UsageError: There is no such node or parameter, or a value is not allowed.
    """
    names = {known.casefold(): known for known in NODES}
    known = names.get(name.casefold())
    if known is None:
        hint = did_you_mean(name, NODES, most=3) or f"there are {', '.join(NODES)}"
        raise UsageError(f"there is no CAN node '{name}': {hint}")
    kind = NODES[known]
    listed: tuple[Parameter, ...] = getattr(kind, "parameters", ())
    allowed = {parameter.name: parameter for parameter in listed}
    for key, value in parameters.items():
        if key not in allowed:
            raise UsageError(f"{known} has no parameter '{key}': it has {', '.join(allowed)}")
        allowed[key].check(known, value)
    return kind(**parameters)  # type: ignore[arg-type]
