"""Makes a C header of the process image: a struct for each domain, as `ecat_image()` returns it."""

from __future__ import annotations

import re
from collections.abc import Iterator

from ecatd.description.bus import Bus, Slave
from ecatd.etg.datatypes import is_real, is_signed, type_name
from ecatd.etg.pdo import Entry, Pdo
from ecatd.etg.pdo_layout import places
from ecatd.etg.scaling import formula_text

from .names import Namespace, component_name, connector_names
from .text import c_comment, identifier

_WHOLE = (8, 16, 32, 64)
_REALS = {32: "float", 64: "double"}
_WIDEST = 64
"""Bits of the widest bit-field."""


def c_structs(bus: Bus, version: str) -> str:
    """Returns the header as text, for C11 and C++11 on machines with little-endian numbers.

    Args:
        bus: The bus description.
        version: Version of the program that writes it.
    """
    prefix = re.sub(r"\W", "_", bus.name)
    prefix = identifier(prefix if not prefix[0].isdigit() else f"bus_{prefix}")
    guard = f"{prefix.upper()}_IMAGE_H"
    domains = range(max([1, len(bus.domains), *(slave.domain + 1 for slave in bus.slaves)]))
    about = f"The process image of bus '{bus.name}', written by ecatctl {version}"
    lines = [
        f"/* {c_comment(about)}.",
        " *",
        " * ecat_image() of <ecat/ecat.h> returns the address of such a struct for each domain.",
        " * Members are raw values. Comments have the object, its name, and the physical value.",
        " * Write outputs with ecat_write(): the outputs in the struct are those that were sent.",
        " */",
        f"#ifndef {guard}",
        f"#define {guard}",
        "",
        "#include <stddef.h>",
        "#include <stdint.h>",
        "",
        "/* If ecat_fingerprint() returns another value, this header does not fit the bus. */",
        f"#define {prefix.upper()}_FINGERPRINT UINT64_C(0x{bus.fingerprint:016x})",
        "",
        "#ifdef __cplusplus",
        f"#define {guard}_ASSERT static_assert",
        "#else",
        f"#define {guard}_ASSERT _Static_assert",
        "#endif",
        "#pragma pack(push, 1)",
    ]
    for domain in domains:
        lines += _domain(bus, domain, prefix, f"{guard}_ASSERT")
    lines += ["", "#pragma pack(pop)", f"#undef {guard}_ASSERT", "#endif"]
    return "\n".join(lines) + "\n"


def _domain(bus: Bus, domain: int, prefix: str, check: str) -> Iterator[str]:
    name = f"{prefix}_image" if domain == 0 else f"{prefix}_image_{domain}"
    namespace, at, checks = Namespace(), 0, []
    yield ""
    yield f"/* {c_comment(bus.domain_label(domain))} */"
    yield f"struct {name} {{"
    for offset, slave, outputs in _areas(bus, domain):
        if offset > at:
            yield f"  uint8_t {namespace.take(f'reserved_{at}')}[{offset - at}];"
        words = component_name(slave.given_name or slave.name, "slave")
        member = namespace.take(f"{words}_{slave.position}_{'outputs' if outputs else 'inputs'}")
        size = slave.output_bytes if outputs else slave.input_bytes
        yield f"  struct {{ /* {c_comment(slave.label)}: {size} bytes from byte {offset} on */"
        yield from _members(slave, outputs, offset)
        yield f"  }} {member};"
        checks.append(f'{check}(offsetof(struct {name}, {member}) == {offset}, "{member}");')
        at = offset + size
    if at == 0:
        yield "  uint8_t nothing;"
    yield "};"
    yield from checks
    if at:
        yield f'{check}(sizeof(struct {name}) == {at}, "{name}");'


def _areas(bus: Bus, domain: int) -> list[tuple[int, Slave, bool]]:
    """Returns first byte, slave, and whether its outputs are there, in the order of the image."""
    found = []
    for slave in bus.slaves:
        if slave.domain == domain and slave.output_bytes:
            found.append((slave.output_offset, slave, True))
        if slave.domain == domain and slave.input_bytes:
            found.append((slave.input_offset, slave, False))
    return sorted(found, key=lambda item: item[0])


def _members(slave: Slave, outputs: bool, offset: int) -> Iterator[str]:
    entries = list(slave.entries(outputs=outputs))
    names = iter(connector_names([(pdo.name, e.name, e.address) for pdo, e, _ in entries]))
    at = 0
    for pdo, entry, bit in places(slave.outputs if outputs else slave.inputs):
        yield from _padding(bit - at)
        at = bit + entry.bit_length
        if entry.is_gap:
            yield from _padding(entry.bit_length)
        else:
            yield from _member(pdo, entry, 8 * offset + bit, next(names))
    yield from _padding(-at % 8)


def _member(pdo: Pdo, entry: Entry, bit: int, name: str) -> Iterator[str]:
    bits = entry.bit_length
    if not bits:
        return
    sign = "" if is_signed(entry.data_type) else "u"
    if bit % 8 == 0 and bits in _WHOLE:
        real = is_real(entry.data_type) and bits in _REALS
        text = f"{_REALS[bits] if real else f'{sign}int{bits}_t'} {name};"
    elif bits <= _WIDEST:
        text = f"{sign}int64_t {name} : {bits};"
    elif bit % 8 == 0 and bits % 8 == 0:
        text = f"uint8_t {name}[{bits // 8}];"
    else:
        yield f"    /* {name}: {_comment(pdo, entry, bit)} */"
        yield from _padding(bits)
        return
    yield f"    {text} /* {_comment(pdo, entry, bit)} */"


def _padding(bits: int) -> Iterator[str]:
    while bits > 0:
        yield f"    uint64_t : {min(bits, _WIDEST)};"
        bits -= _WIDEST


def _comment(pdo: Pdo, entry: Entry, bit: int) -> str:
    byte, rest = divmod(bit, 8)
    place = f"byte {byte}" + (f" bit {rest}" if rest or entry.bit_length < 8 else "")
    name = " / ".join(filter(None, (pdo.name, entry.name)))
    text = f"{place}: {entry.address} {type_name(entry.data_type)} {c_comment(name)}".rstrip()
    if entry.is_physical:
        formula = formula_text("value", entry.scale, entry.offset)
        text += f"; {formula} {c_comment(entry.unit)}".rstrip()
    return text
