"""Applies the configuration to the description of a bus, without any access to the bus."""

from .alike import alike_slaves
from .description import load_description
from .folders import missing_audit_folder, missing_folders
from .misfits import misfits
from .resolved import ResolvedConfig, resolve_config
from .slaves import check_slaves
from .watchdogs import check_watchdog

__all__ = [
    "ResolvedConfig",
    "alike_slaves",
    "check_slaves",
    "check_watchdog",
    "load_description",
    "misfits",
    "missing_audit_folder",
    "missing_folders",
    "resolve_config",
]
