"""How to handle mistakes in the configuration: raise the first one, or collect all of them.

    for rule in rules:
        with problems:
            apply(rule)  # raises ConfigError, or StateError if the bus may change

The daemon ends with the first mistake. `ecatctl config check` wants all of them, from the same
functions.
"""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from types import TracebackType

from ecatd.base.errors import ConfigError, StateError

Problems = AbstractContextManager[object, bool | None]

AT_ONCE: Problems = nullcontext()
"""Raises the first mistake."""


class Collected(AbstractContextManager["Collected", bool]):
    """Collects mistakes. A mistake ends its block.

    Attributes:
        texts: The messages, each once.
    """

    def __init__(self) -> None:
        self.texts: list[str] = []

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> bool:
        """Takes a `ConfigError` or a `StateError`; all other errors go on."""
        wanted = isinstance(error, ConfigError | StateError)
        if wanted and str(error) not in self.texts:
            self.texts.append(str(error))
        return wanted
