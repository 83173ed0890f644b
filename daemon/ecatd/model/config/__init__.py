"""The configuration file, in TOML. `tables` and `docs/configuration.md` describe every key.

Unknown keys are refused, and the message suggests the nearest valid one. Every message starts with
file and line.
"""

from .file import load_config, read_config
from .slaves import DOMAINS_MAX, POSITION_MAX
from .tables import (
    STOPS,
    Config,
    DcConfig,
    DcSlaveConfig,
    DomainConfig,
    GatewayConfig,
    MailboxConfig,
    OutputsConfig,
    RealTimeConfig,
    RecoveryConfig,
    SafeConfig,
    SignalConfig,
)

__all__ = [
    "DOMAINS_MAX",
    "POSITION_MAX",
    "STOPS",
    "Config",
    "DcConfig",
    "DcSlaveConfig",
    "DomainConfig",
    "GatewayConfig",
    "MailboxConfig",
    "OutputsConfig",
    "RealTimeConfig",
    "RecoveryConfig",
    "SafeConfig",
    "SignalConfig",
    "load_config",
    "read_config",
]
