"""The EtherCAT daemon: bus server, gateway, command line and the data they share.

A program needs `from ecatd import Client`. Each name is loaded when it is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .base.errors import EcatError as EcatError
    from .base.errors import LeaseError as LeaseError
    from .base.errors import NoAnswerError as NoAnswerError
    from .base.errors import OwnedError as OwnedError
    from .base.errors import SdoAbortError as SdoAbortError
    from .base.errors import UnreachableError as UnreachableError
    from .client import Client as Client
    from .client import Signal as Signal
    from .client import Validity as Validity

_HOME = {
    **dict.fromkeys(("Client", "Signal", "Validity"), "client"),
    **dict.fromkeys(
        (
            *("EcatError", "LeaseError", "NoAnswerError", "OwnedError"),
            *("SdoAbortError", "UnreachableError"),
        ),
        "base.errors",
    ),
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
