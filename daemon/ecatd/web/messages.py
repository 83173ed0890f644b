"""Messages to pages as JSON text."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

from ecatd.base.errors import EcatError

WORST = "worst"
"""The key of what stood beside the worst cycles (`ecatd.view.worst`), which no query has."""


def encode(message: Mapping[str, Any]) -> str:
    """A message as text. Bytes become hex strings; infinity and NaN, which JSON lacks, null."""
    return json.dumps(_plain(message), separators=(",", ":"), allow_nan=False)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def failure(error: EcatError) -> dict[str, Any]:
    """An error as pages get it: `name`, `message` and the keys of its class."""
    return error.to_reply()
