"""Writes a commented configuration file of a bus as it is."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Iterator
from dataclasses import MISSING, dataclass, field, fields, replace
from textwrap import wrap
from typing import Any

from ecatd.base.log_levels import DEFAULTS
from ecatd.base.sanitized_output import printable, toml_string
from ecatd.description.bus import Bus, Slave
from ecatd.description.limits import SIGNAL_NAME_BYTES, SLAVE_NAME_BYTES
from ecatd.description.modules import module_differences
from ecatd.description.witnesses import contradiction_text
from ecatd.etg.can_terminals import terminal_of
from ecatd.etg.datatypes import STRINGS, parse_type
from ecatd.etg.pdo import Entry

from .config import Config
from .copies import ABSENT
from .pdos import INPUT_PDOS, OUTPUT_PDOS
from .placed import Placed
from .slave_settings import ModuleConfig, SlaveConfig

_WIDTH = 100
_HEX32 = ("vendor", "product", "revision", "revision_min", "ident")
_HEX16 = ("index", "pdos", "identification_register", "id", "flags")
_COPY_EXAMPLE = [
    "",
    "# [[copy]]  # an input of one slave decides an output of another, in every cycle",
    '# slave = "lamps"',
    '# entry = "0x7000:01"',
    '# from_slave = "switches"',
    '# from_entry = "0x6000:01"',
]


@dataclass(slots=True)
class Notes:
    """Lines that files about the bus add to its configuration, as comments.

    Attributes:
        top: Below the first lines.
        slaves: Above the table of a slave, by position.
        pdos: Beside its `pdos`, by position.
        clocks: In `[dc]`, by position.
    """

    top: list[str] = field(default_factory=list)
    slaves: dict[int, list[str]] = field(default_factory=dict)
    pdos: dict[int, list[str]] = field(default_factory=dict)
    clocks: dict[int, list[str]] = field(default_factory=dict)


def write_config(config: Config, bus: Bus, version: str, notes: Notes | None = None) -> str:
    """Makes a configuration that expects the slaves of a bus as they are.

    What is configured stays as it is. Keys with default values are written as comments.

    Args:
        config: What is configured already; it is about the slaves where they are on this bus.
        bus: The bus.
        version: Version of the program, for the first line.
        notes: What files say about the bus besides.

    Returns:
        A file in TOML.
    """
    notes = notes or Notes()
    names = _names(config, bus.slaves)
    expected = replace(config.expected, unlisted=False)
    heads = [item for item in config.slave if item.mark is not None]
    found = {item.position for head in heads for item in (head, *config.followers(head))}
    lines = [
        f"# Configuration of bus '{bus.name}' with its slaves, written by ecatctl {version}.",
        f"# Install it as /etc/ecatd/{bus.name}.toml. docs/configuration-keys.md has all keys.",
        *_comment(notes.top),
        "",
        *_scalars(config, always=("bus", "cycle_time_us"), without=("log",)),
    ]
    lines += ['# interface = "eth1"  # with the slaves'] * (not config.interface)
    lines += ["", "[expected]", *_scalars(expected, always=("policy", "unlisted"))]
    for slave in bus.slaves:
        settings = config.settings_of(slave.position)
        lines += ["", *_about(slave), *_comment(notes.slaves.get(slave.position, ()))]
        beside = notes.pdos.get(slave.position, ())
        placed = slave.position not in found
        lines += _slave(slave, settings, names[slave.position], beside, placed=placed)
    for domain in config.domain:
        row = replace(domain, slaves=[])
        slaves = ", ".join(value_text("", names.get(n, n)) for n in domain.slaves)
        lines += ["", "[[domain]]", *_scalars(row, without=("slaves",)), f"slaves = [{slaves}]"]
    for name in _tables():
        lines += ["", f"[{name}]", *_table(config, name, names, notes)]
    for signal in config.signal:
        lines += ["", "[[signal]]", *_rule(signal, names)]
    copies = [copy for copy in config.copy if copy.from_slave != ABSENT]
    for copy in copies:
        lines += ["", "[[copy]]", *_rule(copy, names)]
    lines += _COPY_EXAMPLE * (not copies)
    return "\n".join(lines) + "\n"


def _names(config: Config, slaves: list[Slave]) -> dict[int, str]:
    """A unique name for each slave, by position: its own, or one made of its order code."""
    own = {n.position: config.settings_of(n.position).name or n.given_name for n in slaves}
    taken = set(own.values())
    return {n.position: own[n.position] or unique_name(n.name, taken) for n in slaves}


def unique_name(text: str, taken: set[str]) -> str:
    """Makes a name for a slave of a text; adds it to the names that are taken."""
    stem = re.sub(r"[^\w-]", "_", text)
    stem = stem if re.match(r"[^\W\d]", stem) else f"slave_{stem}".rstrip("_")
    name, number = _cut(stem, ""), 1
    while name in taken:
        number += 1
        name = _cut(stem, f"_{number}")
    taken.add(name)
    return name


def _cut(stem: str, end: str) -> str:
    return stem.encode()[: SLAVE_NAME_BYTES - len(end)].decode("utf-8", "ignore") + end


def _about(slave: Slave) -> Iterator[str]:
    """What is known of a slave, as comments."""
    parts = [f"revision 0x{slave.revision:08X}"]
    parts += [f"serial number {slave.serial}"] if slave.serial else []
    parts += [f"station alias {slave.alias}"] if slave.alias else []
    parts += [f"identification {slave.identification}"] if slave.identification else []
    name = slave.name or "no order code"
    yield f"# --- slave {slave.position}: {printable(name)} ({', '.join(parts)})"
    for title, pdos in (("outputs", slave.outputs), ("inputs", slave.inputs)):
        for pdo in pdos:
            entries = [_entry(entry) for entry in pdo.entries if not entry.is_gap]
            text = f"{title}, PDO 0x{pdo.index:04X} {printable(pdo.name)}".rstrip()
            yield from _comment([f"{text}: {'; '.join(entries) or 'no entries'}"])
    for item in slave.contradictions:
        if not item.believed:
            yield from _comment([f"{contradiction_text(item)}: choose with pdo_source"])


def _comment(texts: Iterable[str]) -> Iterator[str]:
    """Texts as lines of a comment."""
    for text in texts:
        yield from wrap(
            printable(text),
            _WIDTH,
            initial_indent="# ",
            subsequent_indent="#   ",
            break_long_words=False,
            break_on_hyphens=False,
        )


def _entry(entry: Entry) -> str:
    unit = f" in {printable(entry.unit)}" if entry.unit else ""
    return f"{entry.address} {printable(entry.name)}".rstrip() + unit


def _slave(
    slave: Slave, settings: SlaveConfig, name: str, beside: Iterable[str], *, placed: bool
) -> Iterator[str]:
    identity = replace(
        settings,
        name=name,
        type=printable(slave.name).encode()[:SIGNAL_NAME_BYTES].decode("utf-8", "ignore"),
        vendor=slave.vendor,
        product=slave.product,
        revision_min=slave.revision if settings.revision is None else None,
        pdos=settings.pdos,
    )
    yield "[[slave]]"
    off = slave.watchdog_ms == 0 and not settings.watchdog_ms
    skip = (
        "module",
        "pdo",
        "startup",
        "idn",
        "eoe",
        "can",
        "pdos",
        *["position"] * (not placed),
        *["watchdog_ms"] * off,
    )
    yield from _scalars(identity, always=("position",), without=skip, comments=False)
    if slave.serial and settings.serial is None:
        yield f"# serial = {slave.serial}"
    if slave.identification and settings.identification is None:
        text = "in place of position: finds the slave wherever it stands"
        yield f"# identification = {slave.identification}  # {text}"
    if off:
        yield "watchdog_ms = 0  # it is off: outputs keep their values if ecatd dies; better: 100"
    pdos = None if _has_other_modules(settings, slave) else settings.pdos
    assigned = [pdo.index for pdo in (*slave.outputs, *slave.inputs)]
    usual = len(set(assigned)) == len(assigned) and {*assigned} <= {*OUTPUT_PDOS, *INPUT_PDOS}
    modular = settings.module or slave.modules  # such a slave assigns the PDOs of its modules
    if pdos is None and slave.coe and assigned and usual and not modular:
        pdos = assigned
    if pdos is not None:
        yield f"pdos = {value_text('pdos', pdos)}"
    yield from _comment(beside)
    for module in _modules(settings, slave):
        yield from ("", "[[slave.module]]", *_scalars(module, always=("slot",), comments=False))
    for pdo in settings.pdo:
        yield from ("", "[[slave.pdo]]", f"index = {value_text('index', pdo.index)}", "entries = [")
        for entry in pdo.entries:
            address = f'object = "{entry.object}", ' if entry.object else ""
            yield f"  {{ {address}bits = {entry.bits} }},"
        yield "]"
    for parameter in settings.startup:
        row: Any = parameter
        if parameter.value is not None and parse_type(parameter.type or "") not in STRINGS:
            row = replace(row, value=number_of(parameter.value))
        yield from ("", "[[slave.startup]]")
        yield from _scalars(row, always=("object",), comments=False)
    for idn in settings.idn:
        yield from ("", "[[slave.idn]]", *_scalars(idn, always=("idn",), comments=False))
    if settings.eoe is not None:
        yield from ("", "[slave.eoe]", *_scalars(settings.eoe, comments=False))
    elif slave.eoe:
        yield from ("", "# [slave.eoe]  # its IP parameters", '# address = "192.168.7.2/24"')
    if settings.can is not None:
        yield from ("", "[slave.can]", *_scalars(settings.can, always=("mode",), comments=False))
        for safe in settings.can.safe:
            yield from ("", "[[slave.can.safe]]")
            yield from _scalars(safe, always=("id", "period_ms", "when"), comments=False)
    elif terminal_of(slave.vendor, slave.product) is not None:
        yield from ("", "# [slave.can]  # the CAN bus behind it", "# bit_rate = 500")


def _has_other_modules(settings: SlaveConfig, slave: Slave) -> bool:
    """Whether a slave has other modules than the configuration says."""
    compared = settings.module and slave.modules
    return bool(compared and module_differences(settings.modules, slave.modules))


def _modules(settings: SlaveConfig, slave: Slave) -> Iterator[ModuleConfig]:
    """The modules that a slave has in its slots."""
    if (settings.module and not _has_other_modules(settings, slave)) or not slave.modules:
        yield from settings.module
        return
    for slot, module in enumerate(slave.modules, 1):
        if module.ident:
            yield ModuleConfig(slot, module.ident, printable(module.name))


def _tables() -> Iterator[str]:
    """The tables of the configuration that stand behind those of slaves and domains."""
    for item in fields(Config):
        made = None if item.default_factory is MISSING else item.default_factory()
        if isinstance(made, Placed | dict) and item.name != "expected":
            yield item.name


def _table(config: Config, name: str, names: dict[int, str], notes: Notes) -> Iterator[str]:
    table = getattr(config, name)
    if name == "log":
        for key, level in table.items():
            line = f"{key} = {value_text(key, level)}"
            yield line if level != DEFAULTS.get(key) else f"# {line}"
        return
    yield from _scalars(table, without=("reference",))
    if name == "dc" and table.reference >= 0:
        yield f"reference = {value_text('', names.get(table.reference, table.reference))}"
    for key in ("slave", "safe"):
        for rule in getattr(table, key, ()):
            yield from ("", f"[[{name}.{key}]]", *_rule(rule, names))
            if key == "slave":
                yield from _comment(notes.clocks.get(rule.slave, ()))
    signals = {rule.slave for rule in config.dc.slave}
    for position, texts in notes.clocks.items() if name == "dc" else ():
        if position not in signals and texts:
            yield from ("", *_comment(texts))


def _rule(rule: Any, names: dict[int, str]) -> Iterator[str]:
    """A table about slaves, which it names."""
    slaves = [key.name for key in fields(rule) if key.name in ("slave", "from_slave")]
    for key in slaves:
        position = getattr(rule, key)
        yield f"{key} = {value_text('', names.get(position, position))}"
    yield from _scalars(rule, always=("value", "entry"), without=slaves, comments=False)


def _scalars(
    table: Any,
    *,
    always: Collection[str] = (),
    without: Collection[str] = (),
    comments: bool = True,
) -> Iterator[str]:
    """The keys of a table that hold no tables; those with default values as comments."""
    for key in fields(table):
        value = getattr(table, key.name)
        default = key.default
        if key.default_factory is not MISSING:
            default = key.default_factory()
        tables = isinstance(value, list) and any(not isinstance(v, str | int) for v in value)
        simple = isinstance(value, str | int | float | dict | list)
        if key.name in without or tables or not simple or value in ("", {}):
            continue
        line = f"{key.name} = {value_text(key.name, value)}"
        if value != default or key.name in always:
            yield line
        elif comments and key.name not in ("slave", "domain", "signal", "safe", "copy"):
            yield f"# {line}"


def number_of(text: str) -> Any:
    """The number, or true or false, that a value of a start-up parameter is; else the text."""
    for kind in (int, float):
        try:
            number = kind(text)
        except ValueError:
            continue
        if repr(number) == text and math.isfinite(number):
            return number
    return {"true": True, "false": False}.get(text, text)


def value_text(key: str, value: Any) -> str:
    """The value of a key as it is written in TOML: numbers of devices and PDOs in hexadecimal."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int):
        digits = 8 if key in _HEX32 else 4 if key in _HEX16 else 0
        return f"0x{value:0{digits}X}" if digits else str(value)
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, list):
        return f"[{', '.join(value_text(key, item) for item in value)}]"
    if isinstance(value, dict):
        items = (f"{toml_string(k)} = {value_text('', v)}" for k, v in value.items())
        return f"{{ {', '.join(items)} }}"
    return toml_string(str(value))
