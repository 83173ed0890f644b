"""The names and positions that a bus can have; those of shared memory leave no room for more."""

from __future__ import annotations

import re

POSITION_MAX = 65535
DOMAINS_MAX = 16
SLAVE_NAME_BYTES = DOMAIN_NAME_BYTES = 31
SIGNAL_NAME_BYTES, UNIT_BYTES = 63, 15
"""Most bytes of names and units in UTF-8. Types of devices and modules are as long as signals."""

_SLAVE_NAME = re.compile(r"[^\W\d][\w-]*")
SLAVE_NAME_RULE = (
    f"be a letter, then letters, digits, '_' and '-', at most {SLAVE_NAME_BYTES} bytes in UTF-8"
)


def is_slave_name(name: str) -> bool:
    """Whether a slave or a group of slaves can have this name."""
    return bool(_SLAVE_NAME.fullmatch(name)) and len(name.encode()) <= SLAVE_NAME_BYTES
