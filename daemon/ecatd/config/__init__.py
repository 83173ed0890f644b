"""The configuration file, in TOML. `docs/configuration-keys.md`, made from here, has all keys.

`config` has the whole configuration and `file` reads it; a module for each of the larger tables has
its keys and reads them. `placed` says how a dataclass is a table.

Unknown keys are refused, and the message suggests the nearest valid one. Every message starts with
file and line.
"""

from .can import CanSafeConfig, SlaveCanConfig
from .clocks import DcConfig, DcSlaveConfig
from .config import (
    Config,
    HealthConfig,
    MailboxConfig,
    RealTimeConfig,
    RecoveryConfig,
)
from .copies import ABSENT, CopyConfig
from .domains import DomainConfig
from .file import load_config, read_config
from .gateway import GatewayConfig, UserConfig
from .idns import IdnConfig
from .outputs import STOPS, OutputsConfig, SafeConfig
from .pdos import PdoConfig, PdoEntryConfig
from .signals import SignalConfig
from .slave_settings import STRICT, TOLERANT, ExpectedConfig, Mark, ModuleConfig, SlaveConfig
from .startup import TRANSITIONS, TRANSITIONS_DOWN, StartupConfig

__all__ = [
    "ABSENT",
    "STOPS",
    "STRICT",
    "TOLERANT",
    "TRANSITIONS",
    "TRANSITIONS_DOWN",
    "CanSafeConfig",
    "Config",
    "CopyConfig",
    "DcConfig",
    "DcSlaveConfig",
    "DomainConfig",
    "ExpectedConfig",
    "GatewayConfig",
    "HealthConfig",
    "IdnConfig",
    "MailboxConfig",
    "Mark",
    "ModuleConfig",
    "OutputsConfig",
    "PdoConfig",
    "PdoEntryConfig",
    "RealTimeConfig",
    "RecoveryConfig",
    "SafeConfig",
    "SignalConfig",
    "SlaveCanConfig",
    "SlaveConfig",
    "StartupConfig",
    "UserConfig",
    "load_config",
    "read_config",
]
