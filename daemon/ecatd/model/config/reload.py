"""Says what of a new configuration can be used without a restart."""

from __future__ import annotations

from dataclasses import dataclass, replace

from .differences import differences
from .tables import Config

_AT_ONCE = (
    "audit_file",
    "capture.folder",
    "capture.keep",
    "gateway.",
    "log.",
    "recovery.",
    "outputs.lease_",
)
"""Beginnings of the keys that can change while the bus runs."""


@dataclass(frozen=True, slots=True)
class Reload:
    """What becomes of a new configuration.

    Attributes:
        config: The configuration that is in force from now on.
        used: Keys that have changed in it.
        later: Keys that have changed in the new one, and need a restart.
    """

    config: Config
    used: list[str]
    later: list[str]


def reload(before: Config, wanted: Config) -> Reload:
    """Compares a new configuration with the one in force.

    Args:
        before: The configuration in force.
        wanted: The new one.
    """
    changed = [item.key for item in differences(before, wanted).found]
    used = [key for key in changed if key.startswith(_AT_ONCE)]
    config = replace(
        before,
        audit_file=wanted.audit_file,
        log=wanted.log,
        capture=replace(wanted.capture, memory_mb=before.capture.memory_mb),
        gateway=wanted.gateway,
        recovery=wanted.recovery,
        outputs=replace(
            before.outputs,
            lease_cycles=wanted.outputs.lease_cycles,
            lease_max_ms=wanted.outputs.lease_max_ms,
        ),
    )
    return Reload(config, used, [key for key in changed if key not in used])
