"""The configuration file, in TOML. `tables` and `docs/configuration.md` describe every key.

Unknown keys are refused, and the message suggests the nearest valid one. Every message starts with
file and line.
"""

from .file import load_config, read_config
from .slaves import DOMAINS_MAX
from .tables import (
    ABSENT,
    POSITION_MAX,
    STOPS,
    STRICT,
    TOLERANT,
    TRANSITIONS,
    TRANSITIONS_DOWN,
    Config,
    CopyConfig,
    DcConfig,
    DcSlaveConfig,
    DomainConfig,
    ExpectedConfig,
    GatewayConfig,
    MailboxConfig,
    Mark,
    ModuleConfig,
    OutputsConfig,
    PdoConfig,
    PdoEntryConfig,
    RealTimeConfig,
    RecoveryConfig,
    SafeConfig,
    SignalConfig,
    SlaveConfig,
    StartupConfig,
)

__all__ = [
    "ABSENT",
    "DOMAINS_MAX",
    "POSITION_MAX",
    "STOPS",
    "STRICT",
    "TOLERANT",
    "TRANSITIONS",
    "TRANSITIONS_DOWN",
    "Config",
    "CopyConfig",
    "DcConfig",
    "DcSlaveConfig",
    "DomainConfig",
    "ExpectedConfig",
    "GatewayConfig",
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
    "SlaveConfig",
    "StartupConfig",
    "load_config",
    "read_config",
]
