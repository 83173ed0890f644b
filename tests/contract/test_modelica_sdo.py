"""Requests to the mailboxes of slaves, as the SDO blocks make them: values of all data types."""

import math
from pathlib import Path

import pytest
from sdo_calls import Has, Run, State, answers, build, opened, read, run, write

from conftest import Daemon, names
from ecatd.etg.datatypes import DataType as T
from ecatd.etg.datatypes import bit_length, is_real, value_range
from ecatdev import sample_buses
from ecatdev.checks import check_translation
from ecatgen import generate
from rigs import objects

pytest_plugins = ["sdo_fixtures"]
pytestmark = [pytest.mark.bus, pytest.mark.long]

INTEGERS = [kind for kind in objects.NUMBERS if not is_real(kind)]


def test_a_compiler_reads_a_model_with_all_blocks(tmp_path: Path) -> None:
    generate(sample_buses.troll(), "TrollPlant", tmp_path)
    model = Path(__file__).with_name("Requests.mo")
    (tmp_path / model.name).write_text(model.read_text())
    assert list(check_translation(tmp_path, ["Requests"])) == []


def limits(kind: T) -> tuple[int, int]:
    low, high = value_range(kind, bit_length(kind))
    return low, high


def test_integers_of_all_types_are_written_and_read_back(call: Run) -> None:
    statements, values = [], []
    for kind in INTEGERS:
        low, high = limits(kind)
        for value in {max(low, -(2**31)), min(high, 2**31 - 1), 1, 0}:
            statements.append(write(0x2000 + kind, kind, value))
            statements.append(read(0x2000 + kind, kind))
            values.append(value)
    found = answers(call("".join(statements)))
    assert [answer.state for answer in found] == [State.DONE] * len(found)
    assert [int(answer.value) for answer in found[1::2]] == values


def test_numbers_of_all_types_are_exact_to_53_bits(call: Run) -> None:
    statements, values = [], []
    for kind in objects.NUMBERS:
        low, high = (-1.5, 0.75) if is_real(kind) else limits(kind)
        for value in (float(max(low, -(2**53))), float(min(high, 2**53)), 1.0, 0.0):
            statements.append(write(0x2000 + kind, kind, value, Has.REAL))
            statements.append(read(0x2000 + kind, kind, Has.REAL))
            values.append(value)
    found = answers(call("".join(statements)))
    assert [answer.state for answer in found] == [State.DONE] * len(found)
    assert [float(answer.value) for answer in found[1::2]] == values


@pytest.mark.parametrize(
    ("kind", "value"),
    [(T.INTEGER64, -(2**63)), (T.INTEGER64, 2**63 - 1), (T.UNSIGNED64, 2**64 - 1)],
)
def test_the_largest_integers_are_read_rounded(call: Run, bus: Daemon, kind: T, value: int) -> None:
    bus.ctl("sdo-write", "0", hex(0x2000 + kind), "0", str(value), "--type", kind.name)
    (answer,) = answers(call(read(0x2000 + kind, kind, Has.REAL)))
    assert float(answer.value) == float(value)


def test_real32_is_the_nearest_one(call: Run) -> None:
    largest = (2 - 2**-23) * 2.0**127
    found = answers(
        call(
            "".join(
                write(0x2008, T.REAL32, value, Has.REAL) + read(0x2008, T.REAL32, Has.REAL)
                for value in (0.1, largest, -largest, 1e-45)
            )
        )
    )
    assert [float(answer.value) for answer in found[1::2]] == [
        0.10000000149011612,
        largest,
        -largest,
        1.401298464324817e-45,
    ]


def test_infinity_can_be_read(call: Run, bus: Daemon) -> None:
    bus.ctl("sdo-write", "0", "0x2011", "0", "inf", "--type", "REAL64")
    (answer,) = answers(call(read(0x2011, T.REAL64, Has.REAL)))
    assert float(answer.value) == math.inf


def test_scale_and_offset_are_applied_both_ways(call: Run) -> None:
    scaled = {"scale": 0.25, "offset": -10}
    found = answers(
        call(
            write(0x2003, T.INTEGER16, -8.9, Has.REAL, **scaled)  # 4.4, rounded
            + read(0x2003, T.INTEGER16)
            + read(0x2003, T.INTEGER16, Has.REAL, **scaled)
        )
    )
    assert [float(answer.value) for answer in found[1:]] == [4, -9]


@pytest.mark.parametrize(
    ("index", "kind", "text"),
    [
        (0x2101, T.VISIBLE_STRING, "plain"),
        (0x2101, T.OCTET_STRING, "plain"),
        (0x2102, T.VISIBLE_STRING, "zeros"),
        (0x2102, T.OCTET_STRING, "zeros"),
        (0x2103, T.OCTET_STRING, r"\x00\x01a\x5C\x7F\xFF"),
        (0x2103, T.VISIBLE_STRING, ""),
        (0x2104, T.VISIBLE_STRING, ""),
        (0x2104, T.OCTET_STRING, ""),
        (0x2105, T.VISIBLE_STRING, "Größe"),
        (0x2106, T.VISIBLE_STRING, "Größe"),
        (0x2106, T.OCTET_STRING, r"Gr\xF6\xDFe"),
        (0x2107, T.VISIBLE_STRING, "one?two?"),
        (0x2108, T.UNICODE_STRING, "Ωm 😀"),
        (0x2109, T.UNICODE_STRING, "a?b"),
        (0x210A, T.VISIBLE_STRING, "x" * 512),
        (0x210C, T.VISIBLE_STRING, "ÿ" * 512),
        (0x210C, T.OCTET_STRING, r"\xFF" * 512),
    ],
)
def test_strings_are_read(call: Run, index: int, kind: T, text: str) -> None:
    (answer,) = answers(call(read(index, kind, Has.STRING)))
    assert answer.state is State.DONE
    assert answer.value == text.replace("\\", "\\134")


@pytest.mark.parametrize(
    ("kind", "text", "data"),
    [
        (T.VISIBLE_STRING, "plain", b"plain"),
        (T.VISIBLE_STRING, "Größe \\", "Größe \\".encode()),
        (T.VISIBLE_STRING, "", b"\0"),
        (T.OCTET_STRING, r"a\x00\xfF\x5c", b"a\0\xff\\"),
        (T.UNICODE_STRING, "Ωm 😀", "Ωm 😀".encode("utf-16-le")),
        (T.VISIBLE_STRING, "x" * 512, b"x" * 512),
    ],
)
def test_strings_are_written(call: Run, bus: Daemon, kind: T, text: str, data: bytes) -> None:
    (answer,) = answers(call(write(objects.TEXT, kind, text, Has.STRING)))
    assert answer.state is State.DONE
    found = bus.ctl("sdo-read", "0", hex(objects.TEXT), "0", "--type", "OCTET_STRING").stdout
    assert data.hex(" ") in found


def test_an_object_that_is_too_long_fails_the_request(call: Run) -> None:
    (answer,) = answers(call(read(0x210B, T.VISIBLE_STRING, Has.STRING)))
    assert answer.state is State.FAILED
    assert answer.code < 0
    names(answer.text, "513 bytes", 512)


def test_a_value_that_no_integer_can_hold_fails_the_request(call: Run, bus: Daemon) -> None:
    bus.ctl("sdo-write", "0", "0x2007", "0", "0x80000000", "--type", "UNSIGNED32")
    first, second = answers(call(read(0x2007, T.UNSIGNED32) + read(0x2007, T.UNSIGNED32, Has.REAL)))
    assert (first.state, first.value, first.code) == (State.FAILED, "0", -10)
    names(first.text, 2147483648, "Integer", "Real")
    assert (second.state, second.value) == (State.DONE, "2147483648")


def test_another_length_than_that_of_the_type_fails_the_request(call: Run) -> None:
    (answer,) = answers(call(read(0x1000, T.UNSIGNED8)))
    assert (answer.state, answer.code) == (State.FAILED, -1)
    names(answer.text, "4 bytes", "dataType", 1)


def test_the_object_may_be_given_as_text(call: Run) -> None:
    found = answers(
        call(
            read(0, T.UNSIGNED32, text="0x1018:02")
            + read(0, T.UNSIGNED32, text="1018:02")
            + read(0, T.UNSIGNED8, text="0x1018")
        )
    )
    assert [answer.value for answer in found] == [str(0x78), str(0x78), "4"]


# --- Functions for scripts, which wait -------------------------------------------------------

ONCE = f"""
  ecatm_once_write_integer(argv[1], 0, "0x2003:00", {int(T.INTEGER16)}, -7);
  printf("%d\\n", ecatm_once_read_integer(argv[1], 0, "0x2003:00", {int(T.INTEGER16)}));
  ecatm_once_write_real(argv[1], 0, "0x2011", {int(T.REAL64)}, 0.1);
  printf("%.17g\\n", ecatm_once_read_real(argv[1], 0, "0x2011", {int(T.REAL64)}));
  ecatm_once_write_string(argv[1], 0, "0x2200", {int(T.VISIBLE_STRING)}, "text");
  printf("%s\\n", ecatm_once_read_string(argv[1], 0, "0x2200", {int(T.VISIBLE_STRING)}));
"""


def test_functions_read_and_write_at_once(call: Run) -> None:
    result = call(ONCE)
    assert result.returncode == 0, result.stderr
    assert result.stdout.split() == ["-7", "0.10000000000000001", "text"]


# --- Mistakes --------------------------------------------------------------------------------

BAD = [
    (write(0x2002, T.INTEGER8, 200), "200 is out of range: -128 to 127 are allowed"),
    (write(0x2005, T.UNSIGNED8, -1), "-1 is out of range: 0 to 255 are allowed"),
    (write(0x2001, T.BOOLEAN, 2), "2 is out of range: 0 to 1 are allowed"),
    (write(0x201B, T.UNSIGNED64, 2.0**64, Has.REAL), "1.84467440737096e+19 is out of range: 0 to"),
    (write(0x2015, T.INTEGER64, 2.0**63, Has.REAL), "9.22337203685478e+18 is out of range"),
    (write(0x2008, T.REAL32, 1e39, Has.REAL), "1e+39 is out of range: -3.40282346638529e+38 to"),
    (write(0x2003, T.INTEGER16, 4e3, Has.REAL, scale=0.1), "40000 is out of range: -32768 to"),
    (
        write(objects.TEXT, T.OCTET_STRING, "a\\", Has.STRING),
        "a backslash in the text is not followed by x and two hexadecimal digits",
    ),
    (
        write(objects.TEXT, T.OCTET_STRING, "\\xG0", Has.STRING),
        "the backslash itself is \\x5C",
    ),
    (
        write(objects.TEXT, T.VISIBLE_STRING, "x" * 513, Has.STRING),
        "the text has more than the 512 bytes that can be written",
    ),
    (
        f"void *sdo = {opened(objects.TEXT, T.UNICODE_STRING, Has.STRING)};"
        'int n; for (n = 0; n < 3; n++) ecatm_sdo_write_string(sdo, now, sample(), 1, "\\377");',
        "the text is not valid UTF-8",
    ),
    (
        f"void *sdo = {opened(0x2011, T.REAL64, Has.REAL)};"
        "int n; for (n = 0; n < 3; n++) ecatm_sdo_write_real(sdo, now, sample(), 1, NAN);",
        "nan is out of range",
    ),
    (read(0x1000, T.UNSIGNED32, slave=9), "has no slave 9: it has 3 slaves, 0 to 2"),
    (read(0x1000, T.UNSIGNED32, slave=-1), "slave -1, index 4096, subindex 0 is no object"),
    (read(0x10000, T.UNSIGNED32), "slave 0, index 65536, subindex 0 is no object"),
    (read(0, T.UNSIGNED32, text="0x6060.00"), '"0x6060.00" is no object: write it as'),
    (read(0, T.UNSIGNED32, text="0x6060:"), '"0x6060:" is no object: write it as'),
    (read(0, T.UNSIGNED32, text="0x16060:00"), "0x16060:00 | object"),
    (read(0x2008, T.REAL32), "dataType | 0x0008 | Integer"),
    (read(0x1008, T.VISIBLE_STRING, Has.REAL), "dataType | 0x0009 | Real"),
    (read(0x2007, T.UNSIGNED32, Has.STRING), "dataType | String"),
    (read(0x2007, 0x0E), "dataType | 0x000E"),
    (read(0x2007, T.UNSIGNED32, Has.REAL, scale=0), "scale | finite"),
    (read(0x1000, T.UNSIGNED32, when=2), "0 s | period"),
    # Functions for scripts.
    (
        'ecatm_once_read_integer(argv[1], 0, "0x5FFF:00", 5);',
        "reading | 0x5FFF:00 | slave 0 | 0x06020000",
    ),
    (
        'ecatm_once_write_integer(argv[1], 0, "0x1000:00", 7, 1);',
        "writing | 0x1000:00 | slave 0 | 0x06010002",
    ),
    (
        'ecatm_once_write_integer(argv[1], 0, "0x2005:00", 5, 256);',
        "0x2005:00 | 256 | 0 | 255",
    ),
    (
        'ecatm_once_read_integer(argv[1], 0, "0x1000:00", 5);',
        "0x1000:00 | 4 bytes | dataType | 1",
    ),
    ('ecatm_once_read_integer(argv[1], 9, "0x1000:00", 7);', "slave 9 | 3 slaves"),
    ('ecatm_once_read_integer(argv[1], 0, "", 7);', "slave 0 | index -1 | 65535"),
    (
        'ecatm_once_read_integer(argv[1], 0, "0x2008:00", 8);',
        "dataType | 0x0008 | Integer",
    ),
    ('ecatm_once_read_string(argv[1], 0, "0x2008:00", 8);', "dataType | String"),
    (
        'ecatm_once_read_real("no_such_bus", 0, "0x1000:00", 7);',
        "not running | 'no_such_bus' | 'systemctl start ecatd@no_such_bus'",
    ),
]


@pytest.fixture(scope="module")
def mistakes(tmp_path_factory: pytest.TempPathFactory, compiler: str) -> Path:
    """A program that makes one of them: arguments bus, number."""
    cases = (f"if (atoi(argv[2]) == {n}) {{ {bad} }}" for n, (bad, _) in enumerate(BAD))
    return build(tmp_path_factory.mktemp("mistakes"), compiler, "\n".join(cases))


@pytest.mark.parametrize("number", range(len(BAD)), ids=[tokens for _, tokens in BAD])
def test_what_can_only_be_a_mistake_ends_with_one_sentence(
    mistakes: Path, bus: Daemon, number: int
) -> None:
    result = run(mistakes, bus.bus, str(number))
    assert result.returncode == 1
    assert result.stderr.startswith("EtherCAT: ")
    names(result.stderr, *BAD[number][1].split(" | "))
    assert len(result.stderr.splitlines()) == 1
