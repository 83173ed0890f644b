"""The configuration file: TOML, every key documented in `tables` and in `docs/configuration.md`.

Unknown keys are refused with the nearest valid one, and every message starts with file and line.
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
