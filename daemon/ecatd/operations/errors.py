"""An error in a reply; see `EcatError.to_reply`."""

from __future__ import annotations

from typing import NotRequired

from .operation import Map


class Error(Map):
    """An error."""

    name: str  #: One of [these](troubleshooting.md#errors-by-name).
    message: str  #: What is wrong, where, and what to do.
    code: NotRequired[int]  #: The code of an SDO abort.
    text: NotRequired[str]  #: What the standard says about it.


class Failure(Map):
    """An error reply."""

    error: Error  #: The error.
