"""The configuration file: TOML, every key documented here and in `docs/configuration.md`.

Unknown keys are refused with the nearest valid one, and every message starts with file and line.
"""

from __future__ import annotations

import difflib
import re
import tomllib
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from .errors import ConfigError

BUS_NAME = re.compile(r"[A-Za-z0-9_-]{1,31}")
_ENTRY = re.compile(r"0x([0-9A-Fa-f]{1,4}):([0-9A-Fa-f]{1,2})")


@dataclass(slots=True)
class RealTimeConfig:
    """`[realtime]`: what the cyclic engine asks the system for; what is refused is reported.

    Attributes:
        priority: SCHED_FIFO priority of the engine, 1 to 98; 0 for ordinary scheduling.
        cpu: CPU that the engine is pinned to, -1 for none.
        lock_memory: Lock the memory of the bus server.
        busy_receive: Spin for the answer of the slaves: faster, but a core is always busy.
    """

    priority: int = 80
    cpu: int = -1
    lock_memory: bool = True
    busy_receive: bool = False


@dataclass(slots=True)
class SafeConfig:
    """`[[outputs.safe]]`: the safe value of a slave's outputs, or of one of its entries.

    Attributes:
        slave: Position.
        value: "zero", "hold" (keep what was last sent), or a whole number, which needs `entry`.
        entry: Address such as "0x60FF:00"; empty for all outputs of the slave.
    """

    slave: int
    value: str | int = "zero"
    entry: str = ""

    @property
    def address(self) -> tuple[int, int] | None:
        """Index and subindex of `entry`, or None for the whole slave."""
        match = _ENTRY.fullmatch(self.entry)
        return (int(match[1], 16), int(match[2], 16)) if match else None


@dataclass(slots=True)
class OutputsConfig:
    """`[outputs]`: what happens to outputs whose client stops.

    Attributes:
        lease_cycles: Cycles without a sign of life after which outputs fall to their safe values,
            unless the client asks for a longer lease.
        lease_max_ms: Longest lease that a client can ask for, in milliseconds.
        safe: Safe values that differ from zero.
    """

    lease_cycles: int = 5
    lease_max_ms: int = 500
    safe: list[SafeConfig] = field(default_factory=list)


@dataclass(slots=True)
class GatewayConfig:
    """`[gateway]`: how the bus is seen over Zenoh.

    Attributes:
        listen: Zenoh endpoints for reading, next to the Unix socket of this machine's users.
        publish_hz: Rate at which values of signals are published, 0 for none.
    """

    listen: list[str] = field(default_factory=lambda: ["tcp/127.0.0.1:7447"])
    publish_hz: float = 10.0


@dataclass(slots=True)
class Config:
    """The whole configuration of one bus.

    Attributes:
        bus: Name of the bus: letters, digits, `_` and `-`.
        interface: Network interface with the slaves.
        cycle_time_us: Base cycle in microseconds, 100 to 1000000.
        state_timeout_s: Time that the slaves have to reach a state, in seconds.
    """

    bus: str = "ecat0"
    interface: str = ""
    cycle_time_us: int = 1000
    state_timeout_s: float = 10.0
    realtime: RealTimeConfig = field(default_factory=RealTimeConfig)
    outputs: OutputsConfig = field(default_factory=OutputsConfig)
    gateway: GatewayConfig = field(default_factory=GatewayConfig)

    def to_dict(self) -> dict[str, Any]:
        """The configuration as maps, as `from_dict` takes it."""
        return asdict(self)

    @staticmethod
    def from_dict(data: dict[str, Any]) -> Config:
        """The configuration in maps; raises `ConfigError` as `load` does."""
        return _Reader("configuration", "").read(data)

    @staticmethod
    def load(file: Path) -> Config:
        """Reads and checks a file.

        Raises:
            ConfigError: The file cannot be read, is no TOML, or has a wrong key or value.
        """
        try:
            text = file.read_text("utf-8")
            data = tomllib.loads(text)
        except OSError as error:
            raise ConfigError(f"{file}: cannot be read: {error.strerror}") from error
        except UnicodeDecodeError as error:
            raise ConfigError(f"{file}: is no UTF-8 text: {error}") from error
        except tomllib.TOMLDecodeError as error:
            raise ConfigError(f"{file}: is no valid TOML: {error}") from error
        return _Reader(str(file), text).read(data)


# Key -> (type, smallest, largest); bounds count for numbers only.
_Rule = tuple[type, float, float]
_TOP: dict[str, _Rule] = {
    "bus": (str, 0, 0),
    "interface": (str, 0, 0),
    "cycle_time_us": (int, 100, 1_000_000),
    "state_timeout_s": (float, 0.1, 300),
    "realtime": (dict, 0, 0),
    "outputs": (dict, 0, 0),
    "gateway": (dict, 0, 0),
}
_REALTIME: dict[str, _Rule] = {
    "priority": (int, 0, 98),
    "cpu": (int, -1, 1023),
    "lock_memory": (bool, 0, 0),
    "busy_receive": (bool, 0, 0),
}
_OUTPUTS: dict[str, _Rule] = {
    "lease_cycles": (int, 1, 1_000_000),
    "lease_max_ms": (int, 1, 60_000),
    "safe": (list, 0, 0),
}
_SAFE: dict[str, _Rule] = {
    "slave": (int, 0, 65535),
    "value": (object, 0, 0),
    "entry": (str, 0, 0),
}
_GATEWAY: dict[str, _Rule] = {"listen": (list, 0, 0), "publish_hz": (float, 0, 1000)}

_TYPE_WORDS = {
    str: "a text in quotes",
    int: "a whole number",
    float: "a number",
    bool: "true or false",
    dict: "a table",
    list: "an array",
}


class _Reader:
    """Checks the maps of one file; knows the file's text only to name lines."""

    def __init__(self, file: str, text: str) -> None:
        self._file = file
        self._lines = text.splitlines()

    def read(self, data: dict[str, Any]) -> Config:
        top = self._check(data, _TOP, "")
        outputs = self._check(top.pop("outputs", {}), _OUTPUTS, "outputs")
        outputs["safe"] = [self._safe(row) for row in outputs.pop("safe", [])]
        gateway = self._check(top.pop("gateway", {}), _GATEWAY, "gateway")
        for endpoint in gateway.get("listen", []):
            if not isinstance(endpoint, str) or "/" not in endpoint:
                self._fail(
                    "gateway",
                    "listen",
                    f'{endpoint!r} is no Zenoh endpoint such as "tcp/127.0.0.1:7447"',
                )
        if not BUS_NAME.fullmatch(top.get("bus", "ecat0")):
            self._fail(
                "", "bus", f"{top['bus']!r} is no bus name: use 1 to 31 letters, digits, _ or -"
            )
        if len(top.get("interface", "").encode()) > 15:
            self._fail("", "interface", "an interface name has at most 15 characters")
        realtime = self._check(top.pop("realtime", {}), _REALTIME, "realtime")
        return Config(
            **top,
            realtime=RealTimeConfig(**realtime),
            outputs=OutputsConfig(**outputs),
            gateway=GatewayConfig(**gateway),
        )

    def _safe(self, row: Any) -> SafeConfig:
        if not isinstance(row, dict):
            self._fail("outputs", "safe", "must be an array of tables: write [[outputs.safe]]")
        values = self._check(row, _SAFE, "outputs.safe")
        if "slave" not in values:
            self._fail("outputs.safe", "slave", "is missing: which slave is meant?")
        safe = SafeConfig(**values)
        if safe.entry and safe.address is None:
            self._fail("outputs.safe", "entry", f'{safe.entry!r} is no address such as "0x60FF:00"')
        if isinstance(safe.value, bool) or not isinstance(safe.value, int | str):
            self._fail("outputs.safe", "value", 'must be "zero", "hold" or a whole number')
        if isinstance(safe.value, str) and safe.value not in ("zero", "hold"):
            self._fail(
                "outputs.safe", "value", f'{safe.value!r} is neither "zero" nor "hold" nor a number'
            )
        if isinstance(safe.value, int) and not safe.entry:
            self._fail("outputs.safe", "value", "a number needs an entry: which one is meant?")
        return safe

    def _check(self, data: Any, rules: dict[str, _Rule], table: str) -> dict[str, Any]:
        checked = {}
        for key, value in data.items():
            if key not in rules:
                near = difflib.get_close_matches(key, rules, 1, 0.4)
                hint = f"did you mean '{near[0]}'?" if near else f"valid are {', '.join(rules)}"
                self._fail(table, key, f"is no key; {hint}")
            kind, low, high = rules[key]
            if kind is float and type(value) is int:
                value = float(value)
            if kind is not object and type(value) is not kind:
                self._fail(table, key, f"must be {_TYPE_WORDS[kind]}, not {value!r}")
            if kind in (int, float) and not low <= value <= high:
                self._fail(table, key, f"is {value}, but must be from {low} to {high}")
            checked[key] = value
        return checked

    def _fail(self, table: str, key: str, message: str) -> Any:
        line = self._line(table, key)
        where = f"{self._file}:{line}" if line else self._file
        raise ConfigError(f"{where}: {f'{table}.{key}' if table else key}: {message}")

    def _line(self, table: str, key: str) -> int:
        """Line of a key, 0 if it is not found where one would look."""
        current = ""
        for number, text in enumerate(self._lines, 1):
            header = re.match(r"\s*\[\[?\s*([^\]]+?)\s*\]", text)
            if header:
                current = header[1].replace('"', "")
                if current == (f"{table}.{key}" if table else key):
                    return number
            elif current == table and re.match(rf"\s*\"?{re.escape(key)}\"?\s*[=.]", text):
                return number
        return 0
