"""Checks maps and lists from JSON or msgpack, and makes a bus description of them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

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
_PDOS_MAX = 4096
_ENTRIES_MAX = 65536
_PROFILES_MAX = 256
_PROBLEMS_MAX = 256
_MODULES_MAX = 255
_VALUES_MAX = 4096
_SHOWN = 40
_SAFE_WORDS = ("hold", "actual", "quick_stop", "disable")

_T = TypeVar("_T")
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

_ENTRY: dict[str, Check] = {
    "index": _integer(0, _U16),
    "subindex": _integer(0, _U8),
    "name": _text,
    "data_type": _integer(0, _U16),
    "bit_length": _integer(0, _U8),
    "unit": _printable(UNIT_BYTES),
    "scale": _scale,
    "offset": _number,
    "minimum": _limit,
    "maximum": _limit,
    "display_unit": _rule(is_unit, "be a unit in the notation of Modelica, such as 'rad/s'"),
    "quantity": _rule(_is_quantity, "be the name of a quantity, such as 'AngularVelocity'"),
    "note": _text,
    "connector": _truth,
    "safe": _safe,
}
_MODULE: dict[str, Check] = {"ident": _integer(0, _U32), "name": _printable(SIGNAL_NAME_BYTES)}
_PROFILE: dict[str, Check] = dict.fromkeys(("description", "source"), _text)
_VALUE: dict[str, Check] = {"number": _integer(-_I64, _I64), "name": _text}
_DOMAIN: dict[str, Check] = {
    "name": _printable(DOMAIN_NAME_BYTES),
    "divider": _integer(1, _U16),
    "phase": _integer(0, _U16 - 1),
}


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
        self._entry_keys = _ENTRY | {"values": self._values}
        self._pdo_keys: dict[str, Check] = {
            "index": _integer(0, _U16),
            "name": _text,
            "sync_manager": _integer(0, _U8),
            "entries": lambda value: _list(value, _ENTRIES_MAX, self._entry),
            "witness": _witness,
        }
        self._contradiction_keys: dict[str, Check] = {
            "pdo": _integer(0, _U16),
            "accounts": self._accounts,
            "believed": _witness,
        }
        self._slave_keys: dict[str, Check] = {
            "position": _integer(0, POSITION_MAX),
            "name": _text,
            **dict.fromkeys(("vendor", "product", "revision", "serial"), _integer(0, _U32)),
            **dict.fromkeys(("alias", "address", "identification"), _integer(0, _U16)),
            **dict.fromkeys(("coe", "eoe", "soe"), _truth),
            "problems": lambda value: _list(value, _PROBLEMS_MAX, lambda _, item: _text(item)),
            "profiles": lambda value: _list(value, _PROFILES_MAX, self._profile),
            "given_name": _rule(is_slave_name, SLAVE_NAME_RULE),
            "group": _rule(_is_group, SLAVE_NAME_RULE),
            "modules": lambda value: _list(value, _MODULES_MAX, self._module),
            "outputs": self._pdos,
            "inputs": self._pdos,
            "contradictions": lambda value: _list(value, _PDOS_MAX, self._contradiction),
            "domain": _integer(0, DOMAINS_MAX - 1),
            **dict.fromkeys(("output_offset", "input_offset"), _integer(0, _U32)),
            "dc_bits": _dc_bits,
            **dict.fromkeys(("dc_delay_ns", "sync0_ns", "sync1_ns"), _integer(0, _I64)),
            "sync_shift_ns": _integer(-_I64, _I64),
            "watchdog_ms": _limit,
        }
        self._bus_keys: dict[str, Check] = {
            "name": _bus_name,
            "cycle_time_us": _integer(1, 1_000_000),
            "slaves": lambda value: _list(value, POSITION_MAX + 1, self._slave),
            "domains": lambda value: _list(value, DOMAINS_MAX, self._domain),
            **dict.fromkeys(("schema", "version", "warnings", "fingerprint"), _anything),
        }

    def bus(self, data: Any) -> Bus:
        if not isinstance(data, dict) or "slaves" not in data:
            raise _WrongError("is not a bus description: make one with 'ecatctl scan -o bus.json'")
        if data.get("schema") != SCHEMA:
            raise _WrongError(
                f"has schema {_shown(data.get('schema'))}, but this version reads schema "
                f"{SCHEMA}: scan the bus again with 'ecatctl scan -o bus.json'"
            )
        values = self._keys(data, self._bus_keys, ("name", "cycle_time_us"))
        bus = Bus(
            values["name"], values["cycle_time_us"], values["slaves"], values.get("domains", [])
        )
        domains = max(1, len(bus.domains))
        for slave in bus.slaves:
            if slave.domain >= domains and bus.domains:
                text = f"is {slave.domain}, but there are {domains} domains, 0 to {domains - 1}"
                raise _at(_WrongError(text), "slaves", slave.position, "domain")
        if self._strict:
            _check_fingerprint(bus, values.get("fingerprint"))
        return bus

    def _make(self, kind: Callable[..., _T], data: Any, checks: Mapping[str, Check]) -> _T:
        """Makes a part of the description, which is a dataclass."""
        return kind(**self._keys(data, checks, required_fields(kind)))

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

    def _domain(self, number: int, data: Any) -> Domain:
        domain = self._make(Domain, data, _DOMAIN)
        if domain.phase >= domain.divider:
            text = f"is {domain.phase}, but must be less than the divider, {domain.divider}"
            raise _at(_WrongError(text), "phase")
        return domain

    def _slave(self, number: int, data: Any) -> Slave:
        slave = self._make(Slave, data, self._slave_keys)
        if slave.position != number:
            text = f"is {slave.position}, but slaves follow each other without gaps: {number}"
            raise _at(_WrongError(text), "position")
        return slave

    def _pdos(self, value: Any) -> list[Pdo]:
        return _list(value, _PDOS_MAX, self._pdo)

    def _pdo(self, number: int, data: Any) -> Pdo:
        return self._make(Pdo, data, self._pdo_keys)

    def _accounts(self, value: Any) -> list[Pdo]:
        accounts = self._pdos(value)
        if not accounts or not all(pdo.witness for pdo in accounts):
            raise _WrongError("must be accounts of the PDO, each with its witness")
        return accounts

    def _contradiction(self, number: int, data: Any) -> Contradiction:
        return self._make(Contradiction, data, self._contradiction_keys)

    def _module(self, number: int, data: Any) -> Module:
        return self._make(Module, data, _MODULE)

    def _profile(self, number: int, data: Any) -> ProfileName:
        return self._make(ProfileName, data, _PROFILE)

    def _values(self, value: Any) -> list[Value]:
        return _list(value, _VALUES_MAX, self._value)

    def _value(self, number: int, data: Any) -> Value:
        return self._make(Value, data, _VALUE)

    def _entry(self, number: int, data: Any) -> Entry:
        entry = self._make(Entry, data, self._entry_keys)
        low, high = entry.minimum, entry.maximum
        if low is not None and high is not None and low > high:
            raise _at(_WrongError(f"is {low:g}, more than the maximum, {high:g}"), "minimum")
        if self._strict and is_real(entry.data_type) and not entry.is_gap:
            bits = bit_length(entry.data_type)
            if entry.bit_length != bits:
                text = f"is {entry.bit_length}, but {type_name(entry.data_type)} has {bits} bits"
                raise _at(_WrongError(text), "bit_length")
        return entry


def _check_fingerprint(bus: Bus, given: Any) -> None:
    right = f"{bus.fingerprint:016x}"
    if given not in (None, right):
        text = (
            f"is {_shown(given)}, but that of these slaves is {right}: the description was "
            "changed after the scan; if you have changed it on purpose, remove this key"
        )
        raise _at(_WrongError(text), "fingerprint")
