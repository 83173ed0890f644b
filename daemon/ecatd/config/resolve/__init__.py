"""Applies the configuration to the description of a bus, without any access to the bus."""

from .alike import alike_slaves
from .can import CanChannel, SafeFrame, can_change, can_channel, can_channels, with_can_objects
from .conditions import unused_conditions
from .files import load_description, missing_audit_folder, missing_folders
from .resolved import ResolvedConfig, misfits, resolve_config
from .slaves import check_slaves
from .watchdogs import check_watchdog

__all__ = [
    "CanChannel",
    "ResolvedConfig",
    "SafeFrame",
    "alike_slaves",
    "can_change",
    "can_channel",
    "can_channels",
    "check_slaves",
    "check_watchdog",
    "load_description",
    "misfits",
    "missing_audit_folder",
    "missing_folders",
    "resolve_config",
    "unused_conditions",
    "with_can_objects",
]
