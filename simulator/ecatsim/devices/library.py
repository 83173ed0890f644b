"""The devices that come with ecatsim, by name.

Rig files, programs and `ecatsim devices` find them here:

    from ecatsim.devices.library import make

    terminal = make("EL2004")
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

from ecatd.base.close_names import did_you_mean
from ecatd.base.errors import UsageError

from ..slave.device import Device
from ..slave.sync_managers import default_size
from . import beckhoff, can_terminals, drives
from .encoder import Encoder
from .generic import AnalogIO, DigitalIO, Loopback
from .generic_drive import CiA402Drive
from .modular import ModularIO
from .parameters import Parameter
from .soe_drive import SoeDrive

_CLASSES: Mapping[str, type[Device] | None] = {  # None: `drives` has it
    **{name: getattr(beckhoff, name) for name in beckhoff.__all__},
    "EL6751CAN": can_terminals.EL6751CAN,
    "C2922": can_terminals.C2922,
    "KendrionCAN": can_terminals.KendrionCAN,
    "CiA402": CiA402Drive,
    **dict.fromkeys(drives.NAMES),
    "SoeDrive": SoeDrive,
    "Encoder": Encoder,
    "DigitalIO": DigitalIO,
    "AnalogIO": AnalogIO,
    "ModularIO": ModularIO,
    "Loopback32": Loopback,
}


@dataclass(frozen=True, slots=True)
class LibraryDevice:
    """A device of the library.

    Attributes:
        name: The name that `make` takes.
        summary: Description in one line.
        vendor: Vendor ID.
        product: Product code.
        revision: Revision number.
        output_size: Bytes of outputs with default parameters and default assignment.
        input_size: Bytes of inputs, in the same way.
        parameters: Parameters that can be chosen.
    """

    name: str
    summary: str
    vendor: int
    product: int
    revision: int
    output_size: int
    input_size: int
    parameters: tuple[Parameter, ...]


@cache
def _library() -> tuple[LibraryDevice, ...]:
    return tuple(_describe(name, _class(name)) for name in _CLASSES)


def library() -> list[LibraryDevice]:
    """Returns all devices, couplers and terminals first."""
    return list(_library())


def make(name: str, **parameters: object) -> Device:
    """Makes a new device.

    Args:
        name: Name in the library; upper and lower case are the same.
        **parameters: Values of parameters in `LibraryDevice.parameters`; the others have their
            defaults.

    Raises:
        UsageError: There is no such device or parameter, or a value is not allowed.
    """
    kind, known = _find(name)
    allowed = {parameter.name: parameter for parameter in _parameters(kind)}
    for key, value in parameters.items():
        if key not in allowed:
            choice = f"it has {', '.join(allowed)}" if allowed else "it has none"
            raise UsageError(f"{known} has no parameter '{key}': {choice}")
        allowed[key].check(known, value)
    return kind(**parameters)


def _find(name: str) -> tuple[type[Device], str]:
    names = {known.casefold(): known for known in _CLASSES}
    known = names.get(name.casefold())
    if known is not None:
        return _class(known), known
    hint = did_you_mean(name, _CLASSES, most=3) or "`ecatsim devices` lists all devices"
    raise UsageError(f"there is no device '{name}': {hint}")


def _class(name: str) -> type[Device]:
    return _CLASSES[name] or drives.kind(name)


def _parameters(kind: type[Device]) -> tuple[Parameter, ...]:
    return getattr(kind, "parameters", ())


def _describe(name: str, kind: type[Device]) -> LibraryDevice:
    device = kind()
    return LibraryDevice(
        name,
        _first_sentence(kind),
        device.vendor,
        device.product,
        device.revision,
        default_size(device.rx_pdos),
        default_size(device.tx_pdos),
        _parameters(kind),
    )


def _first_sentence(kind: type[Device]) -> str:
    """Returns the first sentence of the docstring of a device class."""
    line = (kind.__doc__ or "").split("\n", 1)[0]
    return re.split(r"[.:] ", line + " ", maxsplit=1)[0]
