"""Checks maps and lists from JSON or msgpack, and makes a bus description of them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from functools import partial
from typing import Any, get_args, get_origin, get_type_hints

from ecatd.base.bus_name import BUS_NAME, BUS_NAME_RULE
from ecatd.base.dataclass_maps import required_fields
from ecatd.base.errors import UsageError
from ecatd.etg.datatypes import bit_length, is_real, type_name
from ecatd.etg.pdo import Entry, Pdo, Value

from .bus import SCHEMA, Bus, Domain, Module, ProfileName, Slave
from .limits import (
    DOMAIN_NAME_BYTES,
    DOMAINS_MAX,
    POSITION_MAX,
    SIGNAL_NAME_BYTES,
    SLAVE_NAME_RULE,
    UNIT_BYTES,
    is_slave_name,
)
from .units import is_unit
from .witnesses import WITNESSES, Contradiction

_U8, _U16, _U32, _I64 = 0xFF, 0xFFFF, 0xFFFF_FFFF, (1 << 63) - 1
_TEXT_MAX = 4096
_SHOWN = 40
_SAFE_WORDS = ("hold", "actual", "quick_stop", "disable")

Check = Callable[[Any], Any]


class _WrongError(Exception):
    """A mistake in a document.

    Attributes:
        path: Keys and numbers of items that lead to it, outermost first.
    """

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self.path: list[str | int] = []

    def place(self) -> str:
        """The path as text, for example `slaves[2].name`."""
        return "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in self.path).lstrip(".")


def read_bus(data: Any, source: str, *, strict: bool = True) -> Bus:
    """Reads a bus from the maps that `Bus.to_dict` makes.

    Args:
        data: Maps and lists, from JSON or msgpack.
        source: Where they come from, for messages.
        strict: Whether to refuse unknown keys, a wrong fingerprint, and a floating-point entry of
            a wrong length. False for answers of a daemon, which may be newer and have more keys.

    Raises:
        UsageError: The data is not a bus description; the message says where and why.
    """
    try:
        return _Reader(strict=strict).bus(data)
    except _WrongError as error:
        place = error.place()
        raise UsageError(f"{source}: {place}{' ' if place else ''}{error}") from None


def _at(error: _WrongError, *path: str | int) -> _WrongError:
    error.path[:0] = path
    return error


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= _SHOWN else text[: _SHOWN - 1] + "…"


# --- values --------------------------------------------------------------------------------------


def _anything(value: Any) -> Any:
    return value


def _integer(low: int, high: int) -> Check:
    def check(value: Any) -> int:
        if type(value) is int and low <= value <= high:
            return value
        if type(value) is not int:
            raise _WrongError(f"is {_shown(value)}, but must be a whole number")
        raise _WrongError(f"is {_shown(value)}, but must be from {low} to {high}")

    return check


def _text(value: Any) -> str:
    if type(value) is str and len(value) <= _TEXT_MAX:
        return value
    if type(value) is str:
        raise _WrongError(f"has {len(value)} characters, but {_TEXT_MAX} are allowed")
    raise _WrongError(f"is {_shown(value)}, but must be a text")


def _bus_name(value: Any) -> str:
    if BUS_NAME.fullmatch(_text(value)):
        return str(value)
    raise _WrongError(f"is {_shown(value)}, but a bus name {BUS_NAME_RULE}")


def _rule(is_valid: Callable[[str], bool], rule: str) -> Check:
    """A text that is empty, or keeps a rule: that of the configuration, where it comes from."""

    def check(value: Any) -> str:
        if not _text(value) or is_valid(value):
            return str(value)
        raise _WrongError(f"is {_shown(value)}, but must {rule}")

    return check


def _printable(most: int) -> Check:
    return _rule(
        lambda text: text.isprintable() and len(text.encode("utf-8", "replace")) <= most,
        f"be printable and at most {most} bytes long in UTF-8",
    )


def _is_quantity(text: str) -> bool:
    return text.isascii() and text.isidentifier()


def _is_group(text: str) -> bool:
    return is_slave_name(text) or bool(re.fullmatch(r"slave [0-9]{1,5}", text))


def _truth(value: Any) -> bool:
    if type(value) is bool:
        return value
    raise _WrongError(f"is {_shown(value)}, but must be true or false")


def _number(value: Any) -> float:
    try:
        if type(value) in (int, float) and math.isfinite(value):
            return float(value)
    except OverflowError:
        pass
    raise _WrongError(f"is {_shown(value)}, but must be a finite number")


def _scale(value: Any) -> float:
    if number := _number(value):
        return number
    raise _WrongError("is 0, but a scale must not be 0")


def _limit(value: Any) -> float | None:
    return None if value is None else _number(value)


def _safe(value: Any) -> int | float | str | None:
    if value is None or value in _SAFE_WORDS:
        return value  # type: ignore[no-any-return]
    if type(value) is int and -_I64 <= value < 1 << 64:
        return value
    if type(value) is float and math.isfinite(value):
        return value
    raise _WrongError(
        f"is {_shown(value)}, but must be a finite number, null, or one of {', '.join(_SAFE_WORDS)}"
    )


def _witness(value: Any) -> str:
    if value in ("", *WITNESSES):
        return str(value)
    raise _WrongError(f"is {_shown(value)}, but must be one of {', '.join(WITNESSES)}, or empty")


def _dc_bits(value: Any) -> int:
    if type(value) is int and value in (0, 32, 64):
        return value
    raise _WrongError(f"is {_shown(value)}, but a clock has 32 or 64 bits, and 0 is none")


# --- maps and lists ------------------------------------------------------------------------------

_RULES: dict[type, dict[str, Check]] = {
    Bus: {
        "name": _bus_name,
        "cycle_time_us": _integer(1, 1_000_000),
        **dict.fromkeys(("schema", "version", "warnings", "fingerprint"), _anything),
    },
    Domain: {
        "name": _printable(DOMAIN_NAME_BYTES),
        "divider": _integer(1, _U16),
        "phase": _integer(0, _U16 - 1),
    },
    Slave: {
        "position": _integer(0, POSITION_MAX),
        **dict.fromkeys(("vendor", "product", "revision", "serial"), _integer(0, _U32)),
        **dict.fromkeys(("alias", "address", "identification"), _integer(0, _U16)),
        "given_name": _rule(is_slave_name, SLAVE_NAME_RULE),
        "group": _rule(_is_group, SLAVE_NAME_RULE),
        "domain": _integer(0, DOMAINS_MAX - 1),
        **dict.fromkeys(("output_offset", "input_offset"), _integer(0, _U32)),
        "dc_bits": _dc_bits,
        **dict.fromkeys(("dc_delay_ns", "sync0_ns", "sync1_ns"), _integer(0, _I64)),
        "sync_shift_ns": _integer(-_I64, _I64),
        "watchdog_ms": _limit,
    },
    Module: {"ident": _integer(0, _U32), "name": _printable(SIGNAL_NAME_BYTES)},
    Contradiction: {"pdo": _integer(0, _U16), "believed": _witness},
    Pdo: {"index": _integer(0, _U16), "sync_manager": _integer(0, _U8), "witness": _witness},
    Entry: {
        "index": _integer(0, _U16),
        "subindex": _integer(0, _U8),
        "data_type": _integer(0, _U16),
        "bit_length": _integer(0, _U8),
        "unit": _printable(UNIT_BYTES),
        "scale": _scale,
        "offset": _number,
        "minimum": _limit,
        "maximum": _limit,
        "display_unit": _rule(is_unit, "be a unit in the notation of Modelica, such as 'rad/s'"),
        "quantity": _rule(_is_quantity, "be the name of a quantity, such as 'AngularVelocity'"),
        "safe": _safe,
    },
    Value: {"number": _integer(-_I64, _I64)},
}
"""Rules for the keys of parts. Other texts, truth values and lists follow from the types."""
_ITEMS_MAX: dict[type, int] = {
    Slave: POSITION_MAX + 1,
    Domain: DOMAINS_MAX,
    str: 256,
    ProfileName: 256,
    Module: 255,
    Contradiction: 4096,
    Pdo: 4096,
    Entry: 65536,
    Value: 4096,
}
"""Most items of a list, by their type."""


def _list(value: Any, most: int, read: Callable[[int, Any], Any]) -> list[Any]:
    if type(value) is not list:
        raise _WrongError(f"is {_shown(value)}, but must be a list")
    if len(value) > most:
        raise _WrongError(f"has {len(value)} items, but {most} are allowed")
    result: list[Any] = []
    for number, item in enumerate(value):
        try:
            result.append(read(number, item))
        except _WrongError as error:
            raise _at(error, number) from None
    return result


class _Reader:
    """Reads one description.

    Args:
        strict: As for `read_bus`.
    """

    def __init__(self, *, strict: bool) -> None:
        self._strict = strict
        self._checks: dict[type, dict[str, Check]] = {}
        self._afterwards: dict[type, Callable[[int, Any], None]] = {
            Domain: _check_domain,
            Slave: _check_slave,
            Contradiction: _check_contradiction,
            Entry: self._check_entry,
        }

    def bus(self, data: Any) -> Bus:
        if not isinstance(data, dict) or "slaves" not in data:
            raise _WrongError("is not a bus description: make one with 'ecatctl scan -o bus.json'")
        if data.get("schema") != SCHEMA:
            raise _WrongError(
                f"has schema {_shown(data.get('schema'))}, but this version reads schema "
                f"{SCHEMA}: scan the bus again with 'ecatctl scan -o bus.json'"
            )
        bus: Bus = self._part(Bus, 0, data)
        domains = max(1, len(bus.domains))
        for slave in bus.slaves:
            if slave.domain >= domains and bus.domains:
                text = f"is {slave.domain}, but there are {domains} domains, 0 to {domains - 1}"
                raise _at(_WrongError(text), "slaves", slave.position, "domain")
        if self._strict:
            _check_fingerprint(bus, data.get("fingerprint"))
        return bus

    def _part(self, kind: type[Any], number: int, data: Any) -> Any:
        """Makes a part of the description, which is a dataclass, or a text of a list."""
        if kind is str:
            return _text(data)
        if kind not in self._checks:
            self._checks[kind] = self._checks_of(kind)
        part: Any = kind  # mypy takes the hash of a type for that of its instances
        values = self._keys(data, self._checks[kind], required_fields(part))
        made = kind(
            **{item.name: values[item.name] for item in fields(kind) if item.name in values}
        )
        if kind in self._afterwards:
            self._afterwards[kind](number, made)
        return made

    def _checks_of(self, kind: type[Any]) -> dict[str, Check]:
        given, types = _RULES.get(kind, {}), get_type_hints(kind)
        others = {name: self._by_type(types[name]) for name in types.keys() - given.keys()}
        in_order = {name: given.get(name) or others[name] for name in types}
        return in_order | given

    def _by_type(self, kind: Any) -> Check:
        if get_origin(kind) is list:
            (item,) = get_args(kind)
            return lambda value: _list(value, _ITEMS_MAX[item], partial(self._part, item))
        return _truth if kind is bool else _text

    def _keys(
        self, data: Any, checks: Mapping[str, Check], needed: Iterable[str]
    ) -> dict[str, Any]:
        """Checks a map, and returns the values of its known keys."""
        if type(data) is not dict:
            raise _WrongError(f"is {_shown(data)}, but must be a map")
        result = {}
        for key, value in data.items():
            if key not in checks:
                if self._strict:
                    known = ", ".join(checks)
                    raise _WrongError(f"has the key {_shown(key)}, but only {known} are known")
                continue
            try:
                result[key] = checks[key](value)
            except _WrongError as error:
                raise _at(error, key) from None
        for key in needed:
            if key not in result:
                raise _WrongError(f"has no key '{key}'")
        return result

    def _check_entry(self, _number: int, entry: Entry) -> None:
        low, high = entry.minimum, entry.maximum
        if low is not None and high is not None and low > high:
            raise _at(_WrongError(f"is {low:g}, more than the maximum, {high:g}"), "minimum")
        if self._strict and is_real(entry.data_type) and not entry.is_gap:
            bits = bit_length(entry.data_type)
            if entry.bit_length != bits:
                text = f"is {entry.bit_length}, but {type_name(entry.data_type)} has {bits} bits"
                raise _at(_WrongError(text), "bit_length")


def _check_domain(_number: int, domain: Domain) -> None:
    if domain.phase >= domain.divider:
        text = f"is {domain.phase}, but must be less than the divider, {domain.divider}"
        raise _at(_WrongError(text), "phase")


def _check_slave(number: int, slave: Slave) -> None:
    if slave.position != number:
        text = f"is {slave.position}, but slaves follow each other without gaps: {number}"
        raise _at(_WrongError(text), "position")


def _check_contradiction(_number: int, item: Contradiction) -> None:
    if not item.accounts or not all(pdo.witness for pdo in item.accounts):
        text = "must be accounts of the PDO, each with its witness"
        raise _at(_WrongError(text), "accounts")


def _check_fingerprint(bus: Bus, given: Any) -> None:
    right = f"{bus.fingerprint:016x}"
    if given not in (None, right):
        text = (
            f"is {_shown(given)}, but that of these slaves is {right}: the description was "
            "changed after the scan; if you have changed it on purpose, remove this key"
        )
        raise _at(_WrongError(text), "fingerprint")
