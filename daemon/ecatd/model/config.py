"""The configuration file: TOML, every key documented here and in `docs/configuration.md`.

Unknown keys are refused with the nearest valid one, and every message starts with file and line.
"""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NoReturn

from .errors import ConfigError

BUS_NAME = re.compile(r"[A-Za-z0-9_-]{1,31}")
DOMAINS_MAX = 16
_ENTRY = re.compile(r"0x([0-9A-Fa-f]{1,4}):([0-9A-Fa-f]{1,2})")
_POSITIONS = re.compile(r"([0-9]{1,5})(?:\s*-\s*([0-9]{1,5}))?")
_POSITION_MAX = 65535
_NAME_BYTES = 31
_SYNC_MAX_US = 4_000_000  # registers 0x09A0 and 0x09A4 count nanoseconds in 32 bits


@dataclass(slots=True)
class RealTimeConfig:
    """`[realtime]`: what the cyclic engine asks the system for; what is refused is reported.

    Attributes:
        priority: SCHED_FIFO priority of the engine, 1 to 98; 0 for ordinary scheduling.
        cpu: CPU that the engine is pinned to, -1 for none.
        lock_memory: Lock the memory of the bus server.
        busy_receive: Poll for the answer of the slaves and never sleep: faster, but a core is busy
            whenever frames are under way.
        poll_us: How long to poll otherwise before sleeping, in microseconds, where answers usually
            come that soon.
        dma_latency_us: Longest wake-up from an idle state that the CPUs may take, in
            microseconds (held through /dev/cpu_dma_latency); -1 leaves it to the system.
    """

    priority: int = 80
    cpu: int = -1
    lock_memory: bool = True
    busy_receive: bool = False
    poll_us: int = 30
    dma_latency_us: int = 0


@dataclass(slots=True)
class DomainConfig:
    """`[[domain]]`: slaves that are exchanged together; the first table is domain 0.

    Attributes:
        name: Name for people, unique, at most 31 bytes; may be empty.
        divider: Exchanged every so many base cycles, 1 to 65535.
        phase: In those whose number leaves this remainder when divided by it, 0 to divider - 1.
        slaves: Positions of its slaves, "5-7" written out. Slaves that no domain names are in
            domain 0.
    """

    name: str = ""
    divider: int = 1
    phase: int = 0
    slaves: list[int] = field(default_factory=list)


@dataclass(slots=True)
class DcSlaveConfig:
    """`[[dc.slave]]`: the synchronisation signals of one slave.

    Attributes:
        slave: Position.
        sync0_us: Period of SYNC0 in microseconds; 0: the cycle of the slave's domain.
        shift_us: SYNC0 after the start of the reference clock's cycle, in microseconds; None:
            half the base cycle.
        sync1_us: SYNC1 after SYNC0, in microseconds; 0: no SYNC1.
    """

    slave: int
    sync0_us: float = 0.0
    shift_us: float | None = None
    sync1_us: float = 0.0


@dataclass(slots=True)
class DcConfig:
    """`[dc]`: distributed clocks.

    Attributes:
        enabled: Whether clocks are synchronised; true if any `[[dc.slave]]` is there.
        reference: Position of the reference clock; -1: the first slave with a clock.
        phase_us: When in the reference clock's cycle the frames leave, in microseconds.
        lock_us: The cycle is locked to the reference clock when it is within this, in
            microseconds.
        timeout_s: How long a start waits for the lock, in seconds.
        slave: Slaves with synchronisation signals.
    """

    enabled: bool = False
    reference: int = -1
    phase_us: float = 0.0
    lock_us: float = 20.0
    timeout_s: float = 5.0
    slave: list[DcSlaveConfig] = field(default_factory=list)


@dataclass(slots=True)
class MailboxConfig:
    """`[mailbox]`: how much of the wire mailbox and register traffic may take.

    Attributes:
        share: Share of the time in each cycle that the exchange leaves free, 0.01 to 1.
    """

    share: float = 0.5


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
        second_interface: Interface at the other end of the slaves, for cable redundancy; empty
            for none.
        cycle_time_us: Base cycle in microseconds, 100 to 1000000.
        state_timeout_s: Time that the slaves have to reach a state, in seconds.
        domain: Domains, 0 first; without any there is domain 0 with all slaves.
    """

    bus: str = "ecat0"
    interface: str = ""
    second_interface: str = ""
    cycle_time_us: int = 1000
    state_timeout_s: float = 10.0
    domain: list[DomainConfig] = field(default_factory=list)
    dc: DcConfig = field(default_factory=DcConfig)
    mailbox: MailboxConfig = field(default_factory=MailboxConfig)
    realtime: RealTimeConfig = field(default_factory=RealTimeConfig)
    outputs: OutputsConfig = field(default_factory=OutputsConfig)
    gateway: GatewayConfig = field(default_factory=GatewayConfig)

    def domain_of(self, position: int) -> int:
        """Number of the domain of a slave."""
        for number, domain in enumerate(self.domain):
            if position in domain.slaves:
                return number
        return 0

    def domain_cycle_us(self, position: int) -> int:
        """Cycle of the domain of a slave, in microseconds."""
        divider = self.domain[self.domain_of(position)].divider if self.domain else 1
        return self.cycle_time_us * divider

    def sync0_us(self, slave: DcSlaveConfig) -> float:
        """Period of SYNC0 of a slave, in microseconds."""
        return slave.sync0_us or self.domain_cycle_us(slave.slave)

    def shift_us(self, slave: DcSlaveConfig) -> float:
        """SYNC0 of a slave after the start of the reference clock's cycle, in microseconds."""
        return self.cycle_time_us / 2 if slave.shift_us is None else slave.shift_us

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
            return _Reader(str(file), text).read(tomllib.loads(text))
        except OSError as error:
            raise ConfigError(f"{file}: cannot be read: {error.strerror}") from error
        except UnicodeDecodeError as error:
            raise ConfigError(f"{file}: is no UTF-8 text: {error}") from error
        except tomllib.TOMLDecodeError as error:
            raise ConfigError(f"{file}: is no valid TOML: {error}") from error
        except (ValueError, RecursionError) as error:  # thousands of digits, or of brackets
            raise ConfigError(f"{file}: has a value beyond all measure: {error}") from error


# Key -> (type, smallest, largest); bounds count for numbers only.
_Rule = tuple[type, float, float]
_TOP: dict[str, _Rule] = {
    "bus": (str, 0, 0),
    "interface": (str, 0, 0),
    "second_interface": (str, 0, 0),
    "cycle_time_us": (int, 100, 1_000_000),
    "state_timeout_s": (float, 0.1, 300),
    "domain": (list, 0, 0),
    "dc": (dict, 0, 0),
    "mailbox": (dict, 0, 0),
    "realtime": (dict, 0, 0),
    "outputs": (dict, 0, 0),
    "gateway": (dict, 0, 0),
}
_REALTIME: dict[str, _Rule] = {
    "priority": (int, 0, 98),
    "cpu": (int, -1, 1023),
    "lock_memory": (bool, 0, 0),
    "busy_receive": (bool, 0, 0),
    "poll_us": (int, 0, 1000),
    "dma_latency_us": (int, -1, 1_000_000),
}
_DOMAIN: dict[str, _Rule] = {
    "name": (str, 0, 0),
    "divider": (int, 1, 65535),
    "phase": (int, 0, 65534),
    "slaves": (list, 0, 0),
}
_DC: dict[str, _Rule] = {
    "enabled": (bool, 0, 0),
    "reference": (int, -1, _POSITION_MAX),
    "phase_us": (float, 0, 1_000_000),
    "lock_us": (float, 0.1, 500_000),
    "timeout_s": (float, 0.1, 300),
    "slave": (list, 0, 0),
}
_DC_SLAVE: dict[str, _Rule] = {
    "slave": (int, 0, _POSITION_MAX),
    "sync0_us": (float, 0, _SYNC_MAX_US),
    "shift_us": (float, -_SYNC_MAX_US, _SYNC_MAX_US),
    "sync1_us": (float, 0, _SYNC_MAX_US),
}
_MAILBOX: dict[str, _Rule] = {"share": (float, 0.01, 1)}
_OUTPUTS: dict[str, _Rule] = {
    "lease_cycles": (int, 1, 1_000_000),
    "lease_max_ms": (int, 1, 60_000),
    "safe": (list, 0, 0),
}
_SAFE: dict[str, _Rule] = {
    "slave": (int, 0, _POSITION_MAX),
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
        outputs["safe"] = [
            self._safe(row, values)
            for row, values in self._rows(outputs.pop("safe", []), _SAFE, "outputs.safe")
        ]
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
        realtime = self._check(top.pop("realtime", {}), _REALTIME, "realtime")
        mailbox = self._check(top.pop("mailbox", {}), _MAILBOX, "mailbox")
        dc = self._check(top.pop("dc", {}), _DC, "dc")
        clocks = list(self._rows(dc.pop("slave", []), _DC_SLAVE, "dc.slave"))
        for row, values in clocks:
            self._need(values, "slave", "dc.slave", row)
        dc.setdefault("enabled", bool(clocks))
        config = Config(
            domain=self._domains(top.pop("domain", [])),
            **top,
            dc=DcConfig(**dc, slave=[DcSlaveConfig(**values) for _, values in clocks]),
            mailbox=MailboxConfig(**mailbox),
            realtime=RealTimeConfig(**realtime),
            outputs=OutputsConfig(**outputs),
            gateway=GatewayConfig(**gateway),
        )
        self._check_interfaces(config)
        self._check_clocks(config)
        return config

    def _check_interfaces(self, config: Config) -> None:
        for key in ("interface", "second_interface"):
            name = getattr(config, key)
            if len(name.encode("utf-8", "replace")) > 15:
                self._fail("", key, "an interface name has at most 15 characters")
        if config.second_interface and config.second_interface == config.interface:
            self._fail(
                "",
                "second_interface",
                f"is '{config.interface}' like interface: the cable from the last slave back to "
                f"this computer needs an interface of its own",
            )

    def _domains(self, rows: list[Any]) -> list[DomainConfig]:
        if len(rows) > DOMAINS_MAX:
            self._fail("", "domain", f"{len(rows)} tables, but there can be {DOMAINS_MAX} domains")
        domains: list[DomainConfig] = []
        for row, values in self._rows(rows, _DOMAIN, "domain"):
            name = values.get("name", "")
            if not name.isprintable() or len(name.encode("utf-8", "replace")) > _NAME_BYTES:
                self._fail(
                    "domain",
                    "name",
                    f"{name!r} must be printable and at most {_NAME_BYTES} bytes long in UTF-8",
                    row,
                )
            if name and name in (other.name for other in domains):
                self._fail("domain", "name", f"'{name}' is the name of another domain, too", row)
            divider, phase = values.get("divider", 1), values.get("phase", 0)
            if phase >= divider:
                self._fail(
                    "domain",
                    "phase",
                    f"is {phase}, but must be less than the divider, {divider}: the domain is "
                    f"exchanged in cycles whose number leaves this remainder",
                    row,
                )
            values["slaves"] = self._positions(values.get("slaves", []), domains, row)
            if row > 0 and not values["slaves"]:
                self._fail(
                    "domain",
                    "slaves",
                    f'domain {row} has none: write its positions, as in slaves = [0, 3, "5-7"], '
                    f"or leave the table out",
                    row,
                )
            domains.append(DomainConfig(**values))
        return domains

    def _positions(self, items: list[Any], domains: list[DomainConfig], row: int) -> list[int]:
        """Positions written out; `domains` are those in front, which must not have them."""
        taken = {position: n for n, domain in enumerate(domains) for position in domain.slaves}
        positions = []
        for item in items:
            for position in self._position_row(item, row):
                if position in taken:
                    self._fail(
                        "domain",
                        "slaves",
                        f"slave {position} is already in domain {taken[position]}; a slave is in "
                        f"one domain, and named once",
                        row,
                    )
                taken[position] = row
                positions.append(position)
        return positions

    def _position_row(self, item: Any, row: int) -> range:
        """The positions of one element of a list: 5, "5" or "5-7"."""
        match = _POSITIONS.fullmatch(item.strip()) if isinstance(item, str) else None
        if match:
            first, last = int(match[1]), int(match[2] or match[1])
        elif type(item) is int:
            first = last = item
        else:
            first, last = -1, -1
        if not 0 <= first <= last <= _POSITION_MAX:
            self._fail(
                "domain",
                "slaves",
                f'{item!r} is neither a position, 0 to {_POSITION_MAX}, nor a row such as "5-7"',
                row,
            )
        return range(first, last + 1)

    def _check_clocks(self, config: Config) -> None:
        cycle, dc = config.cycle_time_us, config.dc
        if dc.phase_us >= cycle:
            self._fail(
                "dc",
                "phase_us",
                f"is {dc.phase_us:g}, but frames leave within the base cycle, {cycle} µs",
            )
        if dc.lock_us > cycle / 2:
            self._fail(
                "dc",
                "lock_us",
                f"is {dc.lock_us:g}, but no phase is more than half the base cycle, "
                f"{cycle / 2:g} µs, from where it should be",
            )
        seen: set[int] = set()
        for row, slave in enumerate(dc.slave):
            if slave.slave in seen:
                self._fail("dc.slave", "slave", f"slave {slave.slave} has two tables", row)
            seen.add(slave.slave)
            domain = config.domain_cycle_us(slave.slave)
            # In nanoseconds, as the register has it: SYNC0 must not drift against the frames.
            sync0, frames = round(config.sync0_us(slave) * 1000), domain * 1000
            if not 0 < sync0 <= _SYNC_MAX_US * 1000:
                self._fail(
                    "dc.slave",
                    "sync0_us",
                    f"is the cycle of the domain, {domain} µs, but SYNC0 comes at least every "
                    f"{_SYNC_MAX_US} µs: choose a fraction of the cycle",
                    row,
                )
            if sync0 % frames and frames % sync0:
                self._fail(
                    "dc.slave",
                    "sync0_us",
                    f"is {slave.sync0_us:g}, but slave {slave.slave} is exchanged every {domain} "
                    f"µs: it must be a multiple or a whole fraction of that",
                    row,
                )

    def _safe(self, row: int, values: dict[str, Any]) -> SafeConfig:
        self._need(values, "slave", "outputs.safe", row)
        safe = SafeConfig(**values)
        wrong = ""
        if safe.entry and safe.address is None:
            self._fail(
                "outputs.safe", "entry", f'{safe.entry!r} is no address such as "0x60FF:00"', row
            )
        if isinstance(safe.value, bool) or not isinstance(safe.value, int | str):
            wrong = 'must be "zero", "hold" or a whole number'
        elif isinstance(safe.value, str) and safe.value not in ("zero", "hold"):
            wrong = f'{safe.value!r} is neither "zero" nor "hold" nor a number'
        elif isinstance(safe.value, int) and not safe.entry:
            wrong = "a number needs an entry: which one is meant?"
        if wrong:
            self._fail("outputs.safe", "value", wrong, row)
        return safe

    def _need(self, values: dict[str, Any], key: str, table: str, row: int) -> None:
        if key not in values:
            self._fail(table, key, f"is missing: which {key} is meant?", row)

    def _rows(
        self, rows: list[Any], rules: dict[str, _Rule], table: str
    ) -> Iterator[tuple[int, dict[str, Any]]]:
        """The checked tables of an array of tables, with their numbers."""
        for row, values in enumerate(rows):
            if not isinstance(values, dict):
                above, _, key = table.rpartition(".")
                self._fail(above, key, f"must be an array of tables: write [[{table}]]")
            yield row, self._check(values, rules, table, row)

    def _check(
        self, data: dict[str, Any], rules: dict[str, _Rule], table: str, row: int = 0
    ) -> dict[str, Any]:
        checked = {}
        for key, value in data.items():
            if key not in rules:
                near = difflib.get_close_matches(key, rules, 1, 0.4)
                hint = f"did you mean '{near[0]}'?" if near else f"valid are {', '.join(rules)}"
                if key in _TOP:
                    hint = f"'{key}' belongs in front of the first [table] of the file"
                self._fail(table, key, f"is no key; {hint}", row)
            if value is None:
                continue  # from `to_dict`, for a default that other keys decide; TOML has no null
            kind, low, high = rules[key]
            whole = kind is float and type(value) is int
            if kind is not object and type(value) is not kind and not whole:
                self._fail(table, key, f"must be {_TYPE_WORDS[kind]}, not {value!r}", row)
            if kind in (int, float) and not low <= value <= high:
                self._fail(table, key, f"is {value}, but must be from {low} to {high}", row)
            checked[key] = float(value) if whole else value
        return checked

    def _fail(self, table: str, key: str, message: str, row: int = 0) -> NoReturn:
        line = self._line(table, key, row)
        where = f"{self._file}:{line}" if line else self._file
        name = f"{table}.{key}" if table else key
        raise ConfigError(f"{where}: {name if name.isprintable() else repr(name)}: {message}")

    def _line(self, table: str, key: str, row: int) -> int:
        """Line of a key in the table (of an array: in the one with that number).

        A key that is not there, or not where one would look, has the line of its table, else 0.
        """
        current, tables, found = "", 0, 0
        for number, text in enumerate(self._lines, 1):
            header = re.match(r"\s*\[\[?\s*([^\]]+?)\s*\]", text)
            if header:
                current = header[1].replace('"', "")
                if current == (f"{table}.{key}" if table else key):
                    return number
                if current == table:
                    tables += 1
                    found = number if tables == row + 1 else found
            elif (
                current == table
                and (not table or tables == row + 1)
                and re.match(rf"\s*\"?{re.escape(key)}\"?\s*[=.]", text)
            ):
                return number
        return found
