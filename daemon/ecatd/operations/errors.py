"""An error in a reply; see `EcatError.to_reply`."""

from __future__ import annotations

from typing import NotRequired

from .operation import Map


class Error(Map):
    """An error.

    Attributes:
        name: One of [these](troubleshooting.md#errors-by-name).
        message: What is wrong, where, and what to do.
        code: The code of an SDO abort.
        text: What the standard says about it.
    """

    name: str
    message: str
    code: NotRequired[int]
    text: NotRequired[str]


class Failure(Map):
    """An error reply.

    Attributes:
        error: The error.
    """

    error: Error
