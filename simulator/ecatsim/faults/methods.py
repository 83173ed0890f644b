"""One method for every fault, with the parameters of the fault, for whoever can add faults."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, ParamSpec

from .fault import Fault
from .slaves import AlError

_P = ParamSpec("_P")


class _Method(Generic[_P]):
    """A method that adds a fault: its signature is that of the fault's class."""

    def __init__(self, fault: Callable[_P, Fault]) -> None:
        self._fault = fault
        self.__doc__ = fault.__doc__

    def __get__(self, target: FaultMethods, owner: type) -> Callable[_P, int]:
        def add(*args: _P.args, **kwargs: _P.kwargs) -> int:
            return target.add(self._fault(*args, **kwargs))

        add.__doc__ = self._fault.__doc__
        return add


class FaultMethods:
    """Adds faults, to a simulation of this process or to one that runs elsewhere."""

    al_error = _Method(AlError)

    def add(self, fault: Fault) -> int:
        """Adds a fault and returns its number."""
        raise NotImplementedError
