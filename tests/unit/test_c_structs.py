"""`ecatctl cstruct`: the members of the structs lie where the values are in the process image."""

import random
import re
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from bus_strategies import buses
from hypothesis import HealthCheck, given, settings

from ecatd.base.errors import StateError
from ecatd.description.bus import Bus
from ecatd.etg.datatypes import is_real, is_signed
from ecatd.etg.pdo import Entry
from ecatd.master.engine.process_image import lay_out
from ecatdev import sample_buses
from ecatgen.c_structs import c_structs

_STRUCT = re.compile(r"struct (\w+_image\w*) \{")
_END = re.compile(r"  \} (\w+);")
_MEMBER = re.compile(r"    \S+ (\w+)(?: : \d+|\[\d+\])?; /\* byte (\d+)(?: bit (\d+))?: (\S+) ")


def members(text: str) -> Iterator[tuple[str, str, int, str]]:
    """Struct, member, first bit and address of each value of a header."""
    struct, found = "", []
    for line in text.splitlines():
        if match := _STRUCT.match(line):
            struct = match[1]
        elif match := _END.fullmatch(line):
            yield from ((struct, f"{match[1]}.{name}", *rest) for name, *rest in found)
            found = []
        elif match := _MEMBER.match(line):
            found.append((match[1], 8 * int(match[2]) + int(match[3] or 0), match[4]))


def expected(bus: Bus) -> list[tuple[int, Entry]]:
    """First bit and entry of all values of domain 0, in the order of the image."""
    found = []
    for slave in bus.slaves:
        for outputs, offset in ((True, slave.output_offset), (False, slave.input_offset)):
            found += [(8 * offset + bit, e) for _, e, bit in slave.entries(outputs=outputs)]
    return sorted(found, key=lambda item: item[0])


def number(image: bytes, bit: int, entry: Entry) -> int:
    raw = int.from_bytes(image, "little") >> bit & ((1 << entry.bit_length) - 1)
    negative = is_signed(entry.data_type) and raw >> (entry.bit_length - 1)
    return raw - (1 << entry.bit_length) if negative else raw


@pytest.mark.parametrize("make", [sample_buses.troll, sample_buses.axes])
def test_members_have_the_values_of_the_image(
    make: Callable[[], Bus], tmp_path: Path, compiler: str
) -> None:
    bus = make()
    lay_out(bus, set())
    text = c_structs(bus, "1")
    rows = list(members(text))
    wanted = expected(bus)
    assert [(bit, address) for _, _, bit, address in rows] == [(b, e.address) for b, e in wanted]
    image = random.Random(1).randbytes(1 + wanted[-1][0] // 8 + 8)
    printed = [
        f'  memcpy(&raw, &image->{member}, sizeof raw); printf("%lld\\n", (long long)raw);'
        if is_real(entry.data_type)
        else f'  printf("%lld\\n", (long long)image->{member});'
        for (_, member, _, _), (_, entry) in zip(rows, wanted, strict=True)
    ]
    lines = [
        "#include <stdio.h>",
        "#include <string.h>",
        '#include "bus.h"',
        f"static const unsigned char bytes[] = {{{','.join(map(str, image))}}};",
        "int main(void) {",
        f"  const struct {rows[0][0]} *image = (const void *)bytes; uint32_t raw = 0; (void)raw;",
        *printed,
        "  return 0; }",
    ]
    (tmp_path / "bus.h").write_text(text)
    source, program = tmp_path / "read.c", tmp_path / "read"
    source.write_text("\n".join(lines))
    flags = ("-std=c11", "-Wall", "-Wextra", "-Werror")
    subprocess.run([compiler, *flags, source, "-o", program], check=True)
    output = subprocess.run([program], check=True, capture_output=True, text=True).stdout
    assert [int(line) for line in output.split()] == [number(image, *item) for item in wanted]


@pytest.mark.long
@settings(
    max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(bus=buses)
def test_any_bus_has_a_header_that_compiles(bus: Bus, tmp_path: Path, compiler: str) -> None:
    try:
        lay_out(bus, set())
    except StateError:
        return
    source = tmp_path / "bus.c"
    source.write_text(c_structs(bus, "1"))
    for language in (("c", "-std=c11"), ("c++", "-std=c++11")):
        command = [compiler, "-x", *language, "-Wall", "-Werror", "-fsyntax-only", source]
        subprocess.run(command, check=True)
