"""Signals of DBC and EDS files in blocks: what is understood, and what is named and left out."""

from __future__ import annotations

import logging
import re
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import canopen
import pytest
from canopen.objectdictionary import ODVariable
from cantools.database.can import Database
from hypothesis import given, settings
from hypothesis import strategies as st
from pymoca.parser import parse

sys.path.insert(0, str(Path(__file__).parents[1] / "contract"))

from can_messages import DBC

from conftest import names
from ecatd.base.errors import EcatError, StateError, UsageError
from ecatd.description.bus import Bus
from ecatd.etg.datatypes import is_real
from ecatd.etg.pdo import Entry, Value
from ecatdev import sample_buses
from ecatdev.checks import check_conventions, check_structure, check_syntax, check_translation
from ecatgen import can, generate
from ecatgen.build import build_library
from ecatgen.can.eds_text import Eds
from ecatgen.fmu import generate_ls_bus
from ecatgen.ir import Block
from ecatgen.names import Namespace
from ecatgen.render import render
from ecatsim.can.nodes.drive import EDS

SLAVE = 7


@pytest.fixture
def bus() -> Bus:
    return sample_buses.troll()


@pytest.fixture
def read(tmp_path: Path, bus: Bus) -> Callable[..., can.CanFile]:
    """Reads a file with this text."""

    def read_(text: str, who: str = "", name: str = "file.dbc") -> can.CanFile:
        (tmp_path / name).write_text(text)
        option = f"{SLAVE}={tmp_path / name}{'@' if who else ''}{who}"
        return can.read_request(can.parse_option(option), bus)

    return read_


def block(bus: Bus, *files: can.CanFile) -> Block:
    return build_library(bus, "Plant", files).blocks[SLAVE]


def connectors(found: Block, *, sent: bool) -> dict[str, Any]:
    return {str(c.name): c for c in found.can.signals(sent=sent)}


# --- DBC -----------------------------------------------------------------------------------------


def test_who_the_model_is_decides_about_directions(
    read: Callable[..., can.CanFile], bus: Bus
) -> None:
    found = block(bus, read(DBC, "ECU"))
    assert set(connectors(found, sent=True)) == {"commandTarget", "commandEnable", "commandModel"}
    assert set(connectors(found, sent=False)) == {
        *("motorSpeed", "motorPage", "motorTemperature", "motorVoltage", "motorTorque"),
    }
    found = block(bus, read(DBC, "DRIVE"))
    assert "motorSpeed" in connectors(found, sent=True)
    assert set(connectors(found, sent=False)) == {
        *("commandTarget", "commandEnable", "commandModel", "foreignValue"),
    }
    found = block(bus, read(DBC))
    assert not connectors(found, sent=True)
    assert len(connectors(found, sent=False)) == 9


def test_units_types_and_ranges(read: Callable[..., can.CanFile], bus: Bus) -> None:
    found = block(bus, read(DBC, "ECU"))
    reads, writes = connectors(found, sent=False), connectors(found, sent=True)
    speed = reads["motorSpeed"]
    assert (speed.kind, speed.unit, speed.scale) == ("Real", "rpm", 0.1)
    assert speed.description == "Motor: Speed (0x181), from -3200 to 3200 rpm"
    assert speed.note == "of the shaft"
    assert reads["motorPage"].kind == "Integer"
    assert [value.name for value in reads["motorPage"].values] == ["temperature", "voltage"]
    assert writes["commandEnable"].kind == "Boolean"
    assert writes["commandModel"].kind == "Integer"
    command = next(m for m in found.can.messages if m.sent)
    assert (command.identifier, command.extended, command.transmission) == (
        *(0x18FEF1FE, True, "OnChange"),
    )
    signals = {str(s.connector.entry_name): s for m in found.can.messages for s in m.signals}
    assert signals["Temperature"].selector == (16, 8, 0, 1, 1)
    assert (signals["Speed"].start, signals["Speed"].big_endian) == (7, True)
    assert found.left[0].name == "commandTarget"
    assert found.kind == "CAN terminal"


def dbc(*lines: str, more: str = "", length: int = 8, identifier: int = 1) -> str:
    signals_ = "".join(f" SG_ {line}\n" for line in lines)
    return f'VERSION ""\nBU_: A B\nBO_ {identifier} Msg: {length} A\n{signals_}{more}'


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('S : 60|16@1+ (1,0) [0|0] "" B', ["start bit 60", "16 bits", "8 bytes"]),
        ('S : 56|9@0+ (1,0) [0|0] "" B', ["start bit 56"]),
        ('S : 0|8@1+ (0,0) [0|0] "" B', ["factor 0"]),
        ('S m1 : 0|8@1+ (1,0) [0|0] "" B', ["multiplexed", "nothing says"]),
    ],
)
def test_a_signal_that_cannot_be_is_named_and_left_out(
    read: Callable[..., can.CanFile], bus: Bus, line: str, words: Sequence[str]
) -> None:
    file = read(dbc('Good : 8|8@1+ (1,0) [0|0] "" B', line), "A")
    (sentence,) = file.left_out
    names(sentence, "Msg (0x001)", "signal S", *words)
    found = block(bus, file)
    assert list(connectors(found, sent=True)) == ["msgGood"]
    (note,) = build_library(bus, "Plant", [file]).notes
    names(note, "slave 7", "file.dbc", "signal S")


def test_signals_to_be_sent_that_overlap(read: Callable[..., can.CanFile]) -> None:
    text = dbc('One : 0|8@1+ (1,0) [0|0] "" B', 'Two : 7|2@1+ (1,0) [0|0] "" B')
    (sentence,) = read(text, "A").left_out
    names(sentence, "signal Two", "bits of signal One")
    assert not read(text).left_out, "the model only looks at them"


def test_pages_of_a_multiplexer_may_overlap(read: Callable[..., can.CanFile]) -> None:
    assert not read(
        dbc(
            'Page M : 0|8@1+ (1,0) [0|0] "" B',
            'One m1 : 8|8@1+ (1,0) [0|0] "" B',
            'Two m2 : 8|8@1+ (1,0) [0|0] "" B',
        ),
        "A",
    ).left_out


def test_limits_that_leave_nothing_are_left_out(read: Callable[..., can.CanFile]) -> None:
    file = read(dbc('S : 0|8@1+ (1,0) [300|400] "" B', 'T : 8|8@1+ (1,0) [5|1] "" B'))
    one, other = file.left_out
    names(one, "signal S", "300", "400")
    names(other, "signal T", "5", "1")
    assert [s.entry.minimum for s in file.messages[0].signals] == [None, None]


def test_a_multiplexed_multiplexer(read: Callable[..., can.CanFile]) -> None:
    more = (
        "SG_MUL_VAL_ 1 Inner Page 1-1;\nSG_MUL_VAL_ 1 Deep Inner 2-2;\n"
        "SG_MUL_VAL_ 1 X Page 1-2, 5-5;\n"
    )
    file = read(
        dbc(
            'Page M : 0|8@1+ (1,0) [0|0] "" B',
            'Inner m1M : 8|8@1+ (1,0) [0|0] "" B',
            'Deep m2 : 16|8@1+ (1,0) [0|0] "" B',
            'X m1 : 24|8@1+ (1,0) [0|0] "" B',
            more=more,
        )
    )
    one, other = file.left_out
    names(one, "signal Deep", "Inner", "multiplexed itself")
    names(other, "signal X", "Page", "single range")


PAGE = 'Page M : 0|8@1+ (1,0) [0|0] "" B'


def mux(*heads: str) -> list[str]:
    """Signals of 8 bits, one byte behind the other."""
    return [f'{head} : {8 * n}|8@1+ (1,0) [0|0] "" B' for n, head in enumerate(heads)]


@pytest.mark.parametrize(
    ("heads", "more", "gone"),
    [
        (["P M", "Q M", "X m0", "Y m1"], "", ["X", "Y"]),
        (["P M", "Q m1M", "X m0"], "", ["Q", "X"]),
        (["P M", "Q m1M", "X m0"], "SG_MUL_VAL_ 1 Q P 1-1;\n", ["X"]),
        (["P M", "X m0", "Broken M : 9"], "", ["Broken", "X"]),
    ],
)
def test_multiplexed_signals_without_a_known_multiplexer_are_left_out(
    read: Callable[..., can.CanFile], heads: Sequence[str], more: str, gone: Sequence[str]
) -> None:
    file = read(dbc(*mux(*heads), more=more))
    assert len(file.left_out) == len(gone)
    for sentence, signal in zip(file.left_out, gone, strict=True):
        names(sentence, "Msg", signal)
        assert "Broken" in sentence or "nothing says by which signal" in sentence
    kept = [signal for message in file.messages for signal in message.signals]
    assert not any(s.entry.name in gone for s in kept)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("SG_MUL_VAL_ 1 X Nope 1-1;", ["depends on Nope", "no multiplexer"]),
        ("SG_MUL_VAL_ 1 X Page 300-301;", ["Page = 300", "8 bits"]),
        ("SG_MUL_VAL_ 1 Page Page 1-1;", ["signal Page", "SG_MUL_VAL_", "no mark"]),
        ("SG_MUL_VAL_ 1 X Page 3-1;", ["no single range"]),
        ("SG_MUL_VAL_ 1 X Page 1-1; SG_MUL_VAL_ 1 X Other 1-1;", ["several multiplexers"]),
        ("SG_MUL_VAL_ 1 Z Page 1-1;", ["line 8", "signal Z", "not there"]),
        ("SG_MUL_VAL_ 1 X Page one;", ["line 8", "SG_MUL_VAL_ 1 X Page one"]),
    ],
)
def test_a_multiplexer_that_cannot_be(
    read: Callable[..., can.CanFile], more: str, words: Sequence[str]
) -> None:
    file = read(
        dbc(
            PAGE,
            'Plain : 8|8@1+ (1,0) [0|0] "" B',
            *mux("_ M", "_ M", "X m1")[2:],
            more=f"\n{more}\n",
        )
    )
    names(file.left_out[0], *words)


def test_values_of_a_multiplexer_may_be_many(read: Callable[..., can.CanFile]) -> None:
    text = dbc(
        'Page M : 0|24@1+ (1,0) [0|0] "" B',
        'X m0 : 32|8@1+ (1,0) [0|0] "" B',
        'Y m0 : 40|8@1+ (1,0) [0|0] "" B',
        more="SG_MUL_VAL_ 1 X Page 0-16777215;\nSG_MUL_VAL_ 1 Y Page 5-4294967295, 2-4;\n",
    )
    file = read(text)
    assert not file.left_out
    _, one, other = file.messages[0].signals
    assert one.selector == can.Selector(0, 24, False, 0, (1 << 24) - 1)
    assert other.selector == can.Selector(0, 24, False, 2, (1 << 24) - 1)


def test_signals_of_a_multiplexer_that_is_left_out(read: Callable[..., can.CanFile]) -> None:
    file = read(
        dbc(
            'Page M : 20|4@1+ (1,0) [0|0] "" B',
            'X m0 : 0|8@1+ (1,0) [0|0] "" B',
            'Plain : 8|8@1+ (1,0) [0|0] "" B',
            length=2,
        )
    )
    one, other = file.left_out
    names(one, "signal Page", "2 bytes")
    names(other, "signal X", "depends on Page", "left out")
    assert [signal.entry.name for signal in file.messages[0].signals] == ["Plain"]


def test_a_signed_bit_is_a_boolean(read: Callable[..., can.CanFile], bus: Bus) -> None:
    file = read(
        dbc(
            'Bit : 0|1@1- (1,0) [-1|0] "" B',
            'Scaled : 1|1@1- (2,0) [0|0] "" B',
            more='VAL_ 1 Bit -1 "on" 0 "off" ;\n',
        ),
        "A",
    )
    bit, _ = file.messages[0].signals
    found = connectors(block(bus, file), sent=True)
    assert (found["msgBit"].kind, found["msgBit"].type_name) == ("Boolean", "unsigned")
    assert (bit.entry.minimum, bit.entry.maximum) == (None, None)
    assert {value.number: value.name for value in bit.entry.values} == {0: "off", 1: "on"}
    assert (found["msgScaled"].kind, found["msgScaled"].type_name) == ("Real", "signed")
    assert not file.left_out


def test_infinite_limits_are_none(read: Callable[..., can.CanFile], bus: Bus) -> None:
    file = read(
        dbc(
            'S : 0|16@1- (1,0) [0|1e999] "" B',
            'T : 16|16@1- (1e-320,0) [-1e999|1e999] "V" B',
            'U : 32|16@1- (1,0) [1e999|1e999] "" B',
        )
    )
    assert [(s.entry.minimum, s.entry.maximum) for s in file.messages[0].signals] == [
        *((0, None), (None, None), (None, None)),
    ]
    (sentence,) = file.left_out
    names(sentence, "signal U", "leave no value")
    assert connectors(block(bus, file), sent=False)["msgS"].description.endswith("from 0")
    assert render(build_library(bus, "Plant", [file]))


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('S : 4000000000|16@1- (1,0) [0|0] "" B', ["start bit 4000000000"]),
        ('S : 400000000|8@0- (1,0) [0|0] "" B', ["start bit 400000000"]),
        ('S : 0|4000000000@1- (1,0) [0|0] "" B', ["4000000000 bits"]),
        ('S : 0|0@1- (1,0) [0|0] "" B', ["0 bits"]),
        ('S : 0|8@1- (1e999,0) [0|0] "" B', ["factor inf"]),
        (f'S : {"9" * 5000}|8@1- (1,0) [0|0] "" B', ["line 5", "(message Msg)"]),
        ('S : 0|8@1- (1..2,0) [0|0] "" B', ["line 5", "S : 0|8@1- (1..2,0)"]),
        ("S : 0|8", ["line 5", "SG_ S : 0|8"]),
    ],
)
def test_a_bad_signal_takes_no_other_with_it(
    read: Callable[..., can.CanFile], line: str, words: Sequence[str]
) -> None:
    file = read(dbc('Good : 8|8@1+ (1,0) [0|0] "" B', line))
    (sentence,) = file.left_out
    names(sentence, *words)
    assert [signal.entry.name for signal in file.messages[0].signals] == ["Good"]


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ('BO_ 4000 Wide: 8 A\n SG_ S : 0|8@1+ (1,0) [0|0] "" B\n', ["Wide", "0x7FF"]),
        ('BO_ x Odd: 8 A\n SG_ S : 0|8@1+ (1,0) [0|0] "" B\n', ["line 5", "BO_ x Odd"]),
        ('VAL_ 1 Nope 0 "zero" ;\n', ["line 5", "VAL_", "signal Nope"]),
        ("SIG_VALTYPE_ 1 Nope : 1;\n", ["line 5", "SIG_VALTYPE_", "signal Nope"]),
        ("SIG_VALTYPE_ 1 S : 1;\n", ["signal S", "type 1", "16 bits"]),
        ("SIG_VALTYPE_ 1 S : 7;\n", ["signal S", "type 7"]),
        ('VAL_ 1 S 0 "zero\n', ["line 5", "VAL_ 1 S 0"]),
        ('BO_ 1 Again: 8 A\n SG_ S : 0|8@1+ (1,0) [0|0] "" B\n', ["Again", "Msg", "same"]),
        (
            'BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","StandardCAN_FD";\n'
            'BO_ 2 Fd: 8 A\n SG_ S : 0|8@1+ (1,0) [0|0] "" B\nBA_ "VFrameFormat" BO_ 2 1;\n',
            ["Fd (0x002)", "CAN FD"],
        ),
    ],
)
def test_a_bad_statement_takes_no_other_with_it(
    read: Callable[..., can.CanFile], more: str, words: Sequence[str]
) -> None:
    good = ('Good : 32|8@1+ (1,0) [0|0] "" B', 'S : 0|16@1+ (1,0) [0|0] "" B')
    file = read(dbc(*good, more=more))
    names(file.left_out[0], *(word if word != "line 5" else "line 6" for word in words))
    assert [message.name for message in file.messages] == ["Msg"]
    assert file.messages[0].signals[0].entry.name == "Good"


def test_many_statements_that_cannot_be_understood_are_counted(
    read: Callable[..., can.CanFile],
) -> None:
    file = read(dbc('Good : 32|8@1+ (1,0) [0|0] "" B', more="BO_ x\n" * 1000))
    assert len(file.left_out) == 21
    names(file.left_out[-1], "980 more")


@pytest.mark.parametrize(
    ("value", "period", "words"),
    [
        ("0.5", 0.5, []),
        ("100", 100, []),
        ("0", 0, []),
        ("-5", 0, ["Msg", "-5 ms"]),
        ("1e-9", 0, ["1e-9 ms"]),
        ("1e999", 0, ["1e999 ms"]),
        ('"often"', 0, ["often ms"]),
    ],
)
def test_cycle_times(
    read: Callable[..., can.CanFile], bus: Bus, value: str, period: float, words: Sequence[str]
) -> None:
    line = 'S : 0|8@1+ (1,0) [0|0] "" B'
    # Without its definition, the attribute says the same.
    file = read(dbc(line, more=f'BA_ "GenMsgCycleTime" BO_ 1 {value};\n'), "A")
    assert file.messages[0].period_ms == period
    assert len(file.left_out) == bool(words)
    names("".join(file.left_out), *words)
    assert block(bus, file).can.messages[0].period == period / 1000


def test_texts_may_have_anything(read: Callable[..., can.CanFile]) -> None:
    note = 'a \\"quote\\"\nBO_ 5 Fake: 8 A\n SG_ F : 0|8@1+ (1,0) [0|0] ; // no remark'
    text = dbc(
        'S : 0|8@1+ (1,0) [0|0] "m" B // a remark with "quotes"', more=f'CM_ SG_ 1 S "{note}";\n'
    )
    file = read(
        text.replace('VERSION ""', 'VERSION ""\nNS_ :\n\tCM_\n\tBO_TX_BU_\n\tSG_MUL_VAL_\n')
    )
    (message,) = file.messages
    (signal,) = message.signals
    assert not file.left_out
    names(signal.entry.note, 'a "quote"', "Fake", "// no remark")


def test_a_large_file(read: Callable[..., can.CanFile]) -> None:
    messages = "".join(
        f'BO_ {n} M{n}: 8 A\n SG_ S : 0|8@1+ (1,0) [0|0] "" B\n' for n in range(2, 2000)
    )
    comment = f'CM_ SG_ 1 S "{"x" * 5_000_000}";\n'
    file = read(dbc('S : 0|8@1+ (1,0) [0|0] "" B', more=messages + comment))
    assert len(file.messages) == 1999
    assert not file.left_out


def test_more_signals_than_a_block_can_have(read: Callable[..., can.CanFile]) -> None:
    text = "".join(
        f"BO_ {n} M{n}: 8 {'A' if n % 9 else 'B'}\n"
        + "".join(f' SG_ S{bit} : {bit}|1@1+ (1,0) [0|0] "" C\n' for bit in range(64))
        for n in range(600)
    )
    text = f"BU_: A B C D\n{text}"
    with pytest.raises(UsageError) as refused:
        read(text)
    names(str(refused.value), "38400 signals", "at most 30000", "@NODE")
    assert len(read(text, "B").messages) == 67


def test_a_message_with_many_pages(read: Callable[..., can.CanFile]) -> None:
    def text(count: int) -> str:
        pages = [f'S{n} m{n} : 16|8@1+ (1,0) [0|0] "" B' for n in range(count)]
        return dbc('P M : 0|16@1+ (1,0) [0|0] "" B', *pages, 'Q m7 : 20|8@1+ (1,0) [0|0] "" B')

    (sentence,) = read(text(4000), "A").left_out
    names(sentence, "signal Q", "bits of signal S7")
    with pytest.raises(UsageError) as refused:
        read(text(6000), "A")
    names(str(refused.value), "6002 signals", "at most 5000")


@pytest.mark.parametrize(
    "text",
    [
        "SG_MUL_VAL_ 1 X P" + " " * 200_000 + "x",
        "VAL_ 1 " + "9" * 200_000 + "x",
        " SG_ S : 0|8@1+ (" + "9" * 200_000 + ',0) [0|0] "" B',
        " SG_ S : 0|8@1+ (1,0) [" + "9" * 200_000 + '|x] "" B',
        "BU_: " + " ".join(f"N{n}" for n in range(50_000)),
        'VAL_ 1 S 0 "' + '\\"' * 200_000,
        "VAL_ 1 S 0;" + "\t" * 200_000 + "x",
    ],
)
def test_long_statements_take_no_long_time(read: Callable[..., can.CanFile], text: str) -> None:
    file = read(dbc('Good : 8|8@1+ (1,0) [0|0] "" B', more=text))
    assert file.messages[0].signals[0].entry.name == "Good"
    assert all(len(sentence) < 300 for sentence in file.left_out)
    with pytest.raises(UsageError):
        read(f"[{' ' * 200_000}\n{text}", "5", "x.eds")


def test_names_do_not_take_ever_longer() -> None:
    namespace = Namespace()
    taken = [namespace.take("sameName") for _ in range(20_000)]
    assert taken[:3] == ["sameName", "sameName_2", "sameName_3"]
    assert len({name.casefold() for name in taken}) == len(taken)
    other = Namespace()
    other.take("a_2")
    assert [other.take(name) for name in ("a", "a", "A")] == ["a", "a_3", "A_4"]


@settings(max_examples=100, deadline=None)
@given(st.integers(0, len(DBC) - 1), st.integers(1, 40), st.text(max_size=12))
def test_what_cantools_reads_is_read_alike(at: int, length: int, text: str) -> None:
    """Where both understand a damaged file, they have the same signals."""
    damaged = DBC[:at] + text + DBC[at + length :]
    logging.getLogger("cantools").setLevel(logging.CRITICAL)
    judge = Database(strict=False, sort_signals=None)
    try:
        judge.add_dbc_string(damaged)
    except Exception:
        return  # it is stricter
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "x.dbc"
        file.write_bytes(damaged.encode("utf-8", "replace"))
        try:
            found = can.read_request(can.parse_option(f"7={file}"), sample_buses.troll())
        except UsageError:
            return
    expected = {(m.frame_id, m.is_extended_frame): m for m in judge.messages}
    for message in found.messages:
        of_judge = {s.name: s for s in expected[message.identifier, message.extended].signals}
        for signal in message.signals:
            other = of_judge[signal.entry.name]
            assert (signal.start, signal.big_endian) == (
                *(other.start, other.byte_order == "big_endian"),
            )
            assert (signal.entry.bit_length, signal.entry.scale, signal.entry.offset) == (
                *(other.length, other.scale, other.offset),
            )
            assert is_real(signal.entry.data_type) == other.is_float
            assert (signal.selector is None) == (other.multiplexer_ids is None)


def test_a_message_without_anything_that_can_be_used(read: Callable[..., can.CanFile]) -> None:
    text = (
        'VERSION ""\nBU_: A\nBO_ 1 Empty: 8 A\n\n'
        'BO_ 2 Long: 64 A\n SG_ S : 0|8@1+ (1,0) [0|0] "" A\n'
    )
    with pytest.raises(UsageError) as refused:
        read(text)
    names(str(refused.value), "file.dbc", "Empty (0x001)", "no signals", "Long (0x002)", "64 bytes")


@pytest.mark.parametrize(
    "text", ["", "hello", 'VERSION "', "BO_ x", '\x00\xff"', "BO_ 4294967296 A: 8 B\n"]
)
def test_a_file_that_is_no_dbc(read: Callable[..., can.CanFile], text: str) -> None:
    with pytest.raises(UsageError) as refused:
        read(text)
    assert "file.dbc" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_node_that_is_not_there(read: Callable[..., can.CanFile]) -> None:
    with pytest.raises(UsageError) as refused:
        read(DBC, "EUC")
    names(str(refused.value), "EUC", "did you mean 'ECU'?")


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ("7", ["7", "SLAVE=FILE"]),
        ("=x.dbc", ["SLAVE=FILE"]),
        ("7=", ["SLAVE=FILE"]),
        ("7=nowhere.dbc", ["nowhere.dbc"]),
        ("7=nowhere.dbc@ECU", ["nowhere.dbc"]),
    ],
)
def test_options_that_are_malformed(option: str, words: Sequence[str]) -> None:
    with pytest.raises(UsageError) as refused:
        can.parse_option(option)
    names(str(refused.value), "--can", *words)


def test_a_file_of_another_kind(tmp_path: Path) -> None:
    (tmp_path / "x.xml").write_text("")
    with pytest.raises(UsageError) as refused:
        can.parse_option(f"7={tmp_path}/x.xml")
    names(str(refused.value), "x.xml", "DBC", "EDS")


def test_a_slave_that_is_not_there(tmp_path: Path, bus: Bus) -> None:
    (tmp_path / "x.dbc").write_text(DBC)
    with pytest.raises(StateError):
        can.read_request(can.parse_option(f"77={tmp_path}/x.dbc"), bus)


def test_messages_of_two_files_with_one_identifier(
    read: Callable[..., can.CanFile], bus: Bus
) -> None:
    found = block(bus, read(DBC, "ECU"), read(DBC, "ECU", "other.dbc"))
    assert len(found.can.messages) == 2
    assert len(found.can.left_out) == 2
    names(found.can.left_out[0], "other.dbc", "Motor (0x181)", "same identifier")


# --- EDS -----------------------------------------------------------------------------------------

EDS_OBJECTS = {
    0x6040: ("Controlword", 6, None),
    0x6041: ("Statusword", 6, None),
    0x606C: ("Velocity actual value", 4, None),
    0x6060: ("Modes of operation", 2, (-128, 127)),
    0x2000: ("Text", 9, None),
}


def eds(pdos: dict[int, tuple[str, Sequence[int]]]) -> str:
    """A file with these PDOs: communication index, COB-ID and mapping."""
    lines = ["[FileInfo]\nFileName=drive.eds\n[DeviceInfo]\nVendorName=V\n"]
    for index, (name, kind, limits) in EDS_OBJECTS.items():
        limit = f"LowLimit={limits[0] & 0xFF:#x}\nHighLimit={limits[1]:#x}\n" if limits else ""
        lines.append(
            f"[{index:04X}]\nParameterName={name}\nObjectType=0x7\nDataType={kind:#06x}\n"
            f"AccessType=rw\nPDOMapping=1\n{limit}"
        )
    for index, (cob, mapping) in pdos.items():
        lines.append(
            f"[{index:04X}]\nParameterName=PDO parameter\nObjectType=0x9\nSubNumber=3\n"
            f"[{index:04X}sub0]\nParameterName=n\nObjectType=0x7\nDataType=0x5\nAccessType=ro\n"
            f"DefaultValue=5\n"
            f"[{index:04X}sub1]\nParameterName=COB-ID\nObjectType=0x7\nDataType=0x7\nAccessType=rw\n"
            f"DefaultValue={cob}\n"
            f"[{index:04X}sub2]\nParameterName=type\nObjectType=0x7\nDataType=0x5\nAccessType=rw\n"
            f"DefaultValue=255\n"
            f"[{index:04X}sub5]\nParameterName=timer\nObjectType=0x7\nDataType=0x6\nAccessType=rw\n"
            f"DefaultValue=100\n"
        )
        index += 0x200
        lines.append(
            f"[{index:04X}]\nParameterName=mapping\nObjectType=0x9\nSubNumber={len(mapping) + 1}\n"
            f"[{index:04X}sub0]\nParameterName=n\nObjectType=0x7\nDataType=0x5\nAccessType=rw\n"
            f"DefaultValue={len(mapping)}\n"
        )
        for number, word in enumerate(mapping, start=1):
            lines.append(
                f"[{index:04X}sub{number:X}]\nParameterName=m{number}\nObjectType=0x7\n"
                f"DataType=0x7\nAccessType=rw\nDefaultValue={word:#010x}\n"
            )
    return "".join(lines)


DRIVE = eds(
    {
        0x1400: ("$NODEID+0x200", [0x60400010, 0x60600008]),
        0x1401: ("0x80000300", [0x60400010]),
        0x1800: ("$NODEID+0x180", [0x60410010, 0x00050008, 0x606C0020]),
        0x1801: ("$NODEID+0x280", [0x20000040, 0x60410008, 0x70000008]),
    }
)


def test_the_pdos_of_a_device(read: Callable[..., can.CanFile], bus: Bus) -> None:
    file = read(DRIVE, "5", "drive.eds")
    rpdo, tpdo = file.messages
    assert (rpdo.identifier, rpdo.sent, rpdo.length) == (0x205, True, 3)
    assert (tpdo.identifier, tpdo.sent, tpdo.length) == (0x185, False, 7)
    assert [signal.start for signal in tpdo.signals] == [0, 24], "a dummy keeps 8 bits free"
    found = block(bus, file)
    assert set(connectors(found, sent=True)) == {
        *("node5RPDO1Controlword", "node5RPDO1ModesOfOperation"),
    }
    velocity = connectors(found, sent=False)["node5TPDO1VelocityActualValue"]
    assert (velocity.type_name, velocity.kind) == ("signed", "Integer")
    message = next(m for m in found.can.messages if not m.sent)
    assert message.timeout == 0.3, "three times its event timer"
    modes = rpdo.signals[1].entry
    assert (modes.minimum, modes.maximum) == (-128, 127)


def test_pdos_that_are_off_or_map_what_is_no_number(read: Callable[..., can.CanFile]) -> None:
    left_out = "\n".join(read(DRIVE, "5", "drive.eds").left_out)
    assert "Node5 RPDO2 is off by default (0x1401:01 = 0x80000300)" in left_out
    names(left_out, "0x2000:00", "no number")
    names(left_out, "0x6041:00", "16 bits", "8")
    names(left_out, "0x7000:00", "the file does not have it")


def test_a_part_that_the_device_does_not_have(read: Callable[..., can.CanFile]) -> None:
    array = (
        "[3000]\nParameterName=List\nObjectType=0x8\nSubNumber=2\n"
        "[3000sub1]\nParameterName=first\nDataType=0x5\n"
        "[3001]\nParameterName=Short\nObjectType=0x8\nDataType=0x5\nCompactSubObj=2\n"
        "[3001Name]\nNrOfEntries=1\n2=second\n"
    )
    mapping = [0x30000108, 0x30000908, 0x30010108, 0x30010208, 0x30010308]
    file = read(eds({0x1800: ("0x181", mapping)}) + array, "5", "x.eds")
    assert [signal.entry.name for signal in file.messages[0].signals] == [
        *("List first", "Short 1", "Short second"),
    ]
    one, other = file.left_out
    names(one, "0x3000:09 is mapped, but the file does not have it")
    names(other, "0x3001:03 is mapped, but the file does not have it")


@pytest.mark.parametrize(
    ("cob", "words"),
    [
        ("0x00001181", ["0x00001181", "11 bits", "bit 29"]),
        ("$NODEID+0x00001180", ["0x00001185", "11 bits"]),
        ("$NODEID+$NODEID", ["no default"]),
        ("0x1FFFFFFFFF", ["no default"]),
        ("often", ["no default"]),
    ],
)
def test_identifiers_that_cannot_be(
    read: Callable[..., can.CanFile], cob: str, words: Sequence[str]
) -> None:
    text = eds({0x1800: ("$NODEID+0x180", [0x60410010]), 0x1801: (cob, [0x60410010])})
    file = read(text, "5", "x.eds")
    (sentence,) = file.left_out
    names(sentence, "Node5 TPDO2", *words)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ("DataType=", ["no data type"]),
        ("DataType=0x99", ["no number"]),
        ("DataType=0x6\nDataType=0x3", ["different things"]),
        ("DataType=0x6\n[3000]\nDataType=0x6", ["different things"]),
        ("DataType=0x6\nFactor=some", ["factor 'some'"]),
        ("DataType=0x3\nLowLimit=0x12345", ["limit 0x12345", "left out"]),
    ],
)
def test_a_bad_object_takes_no_other_with_it(
    read: Callable[..., can.CanFile], lines: str, words: Sequence[str]
) -> None:
    text = eds({0x1800: ("0x181", [0x60410010, 0x30000010])})
    file = read(f"{text}[3000]\nParameterName=Bad\n{lines}\n", "5", "x.eds")
    (sentence,) = file.left_out
    names(sentence, "object 0x3000:00", *words)
    assert file.messages[0].signals[0].entry.name == "Statusword"
    assert all(s.entry.minimum is None for s in file.messages[0].signals)


def test_limits_of_signed_objects(read: Callable[..., can.CanFile]) -> None:
    text = eds({0x1400: ("0x201", [0x30000010])})
    limits = "DataType=0x3\nLowLimit=0xFF9C\nHighLimit=100 ; comment\nFactor=-0.5"
    file = read(f"{text}[3000]\nParameterName=Torque\n{limits}\n", "5", "x.eds")
    entry = file.messages[0].signals[0].entry
    assert (entry.minimum, entry.maximum, entry.scale) == (-50, 50, -0.5)


@pytest.mark.parametrize("name", ["x.dbc", "x.eds"])
def test_encodings(tmp_path: Path, bus: Bus, name: str) -> None:
    path = tmp_path / name
    text = DRIVE if name == "x.eds" else DBC.replace("of the shaft", "of the shaft (°)")
    text = text.replace("Statusword", "Größe").replace("\n", "\r\n")
    path.write_bytes(text.encode("utf-8"))
    request = can.parse_option(f"7={path}@{'5' if name == 'x.eds' else 'ECU'}")
    expected = can.read_request(request, bus)
    for encoding in ("cp1252", "utf-8-sig"):
        path.write_bytes(text.encode(encoding))
        assert can.read_request(request, bus) == expected
    path.write_bytes(text.encode("utf-16"))
    with pytest.raises(UsageError) as refused:
        can.read_request(request, bus)
    names(str(refused.value), name, "UTF-16", "save it in UTF-8")


def test_what_canopen_reads_is_read_alike() -> None:
    dictionary = canopen.import_od(str(EDS), node_id=5)
    found = Eds(EDS.read_text(), 5)
    seen = 0
    for index, item in dictionary.items():
        parts = [item] if isinstance(item, ODVariable) else list(item.values())
        for part in parts:
            variable = found.variable(index, part.subindex)
            assert variable is not None
            assert variable.data_type == part.data_type
            if isinstance(part.default, int):
                assert variable.value == part.default
                seen += 1
    assert seen > 50


@pytest.mark.parametrize("who", ["", "0", "128", "drive"])
def test_a_device_without_a_node_id(read: Callable[..., can.CanFile], who: str) -> None:
    with pytest.raises(UsageError) as refused:
        read(DRIVE, who, "drive.eds")
    names(str(refused.value), "node ID", "1 to 127")


@pytest.mark.parametrize("text", ["", "[", "[1800]", "[1800sub1]\nParameterName=x", "\x00"])
def test_a_file_that_is_no_eds(read: Callable[..., can.CanFile], text: str) -> None:
    with pytest.raises(UsageError) as refused:
        read(text, "5", "drive.eds")
    assert "drive.eds" in str(refused.value)
    assert "\n" not in str(refused.value)


# --- what is generated ---------------------------------------------------------------------------


def test_the_library(tmp_path: Path, read: Callable[..., can.CanFile], bus: Bus) -> None:
    files = [read(DBC, "ECU"), read(DRIVE, "5", "drive.eds")]
    report = generate(bus, "Plant", tmp_path, messages=files)
    assert any("RPDO2" in line for line in report.details())
    library = tmp_path / "Plant"
    assert list(check_structure(library)) == []
    assert list(check_syntax(library)) == []
    assert list(check_conventions(library)) == []
    assert list(check_translation(tmp_path, ["Plant.Examples.AllSlaves"])) == []


def test_later_runs_remember_the_files(
    tmp_path: Path, read: Callable[..., can.CanFile], bus: Bus
) -> None:
    generate(bus, "Plant", tmp_path, messages=[read(DBC, "ECU")])
    assert not generate(bus, "Plant", tmp_path, check=True).is_change
    assert not generate(bus, "Plant", tmp_path, messages=[read(DBC, "ECU")], check=True).is_change
    moved = sample_buses.troll()
    del moved.slaves[SLAVE]
    with pytest.raises(StateError) as refused:
        generate(moved, "Plant", tmp_path)
    names(str(refused.value), "file.dbc", "slave 7", "--can none")
    generate(bus, "Plant", tmp_path, messages=[])
    assert not (tmp_path / "Plant" / "Resources" / "can.json").exists()
    assert "motorSpeed" not in (tmp_path / "Plant" / "EL6751_2.mo").read_text()


def test_a_terminal_with_a_name_is_found_where_it_is(
    tmp_path: Path, read: Callable[..., can.CanFile], bus: Bus
) -> None:
    bus.slaves[SLAVE].given_name = "bridge"
    generate(bus, "Plant", tmp_path, messages=[read(DBC, "ECU")])
    moved = sample_buses.troll()
    moved.slaves[6].given_name = "bridge"
    generate(moved, "Plant", tmp_path)
    assert "position = 6" in (tmp_path / "Plant" / "Bridge.mo").read_text()
    assert "motorSpeed" in (tmp_path / "Plant" / "Bridge.mo").read_text()


def test_differences(tmp_path: Path, read: Callable[..., can.CanFile], bus: Bus) -> None:
    generate(bus, "Plant", tmp_path, messages=[read(DBC, "ECU")])
    text = DBC.replace('"rpm"', '"rad/s"').replace("Enable : 32|1@1+", "Enable : 33|1@1+")
    text = text.replace(' SG_ Torque : 32|32@1- (1,0) [0|0] "N.m" ECU\n', "")
    text = text.replace("SIG_VALTYPE_ 385 Torque : 1;\n", "")
    report = generate(bus, "Plant", tmp_path, messages=[read(text, "ECU")], check=True)
    lines = "\n".join(item.sentence for item in report.differences)
    names(lines, "motorSpeed", "rpm", "rad/s")
    names(lines, "start bit 32", "start bit 33")
    names(lines, "motorTorque", "is gone")
    assert not report.otherwise


NAMES = st.text(st.characters(codec="utf-8"), max_size=40)


@settings(max_examples=40, deadline=None)
@given(NAMES, NAMES, NAMES)
def test_any_text_of_a_file_stays_a_text(message: str, signal: str, unit: str) -> None:
    entry = Entry(1, 0, signal, 0x1B, 8, unit=unit, values=[Value(1, unit)], note=signal)
    made = [
        can.CanMessage(
            message, number, False, 8, sent, note=unit, signals=(can.CanSignal(entry, 0),)
        )
        for number, sent in enumerate((True, False))
    ]
    file = can.CanFile(SLAVE, "", 2, 0x1A5F3052, message, tuple(made), (signal,))
    assert can.parse(can.dump([file])) == (file,)
    for path, text in render(build_library(sample_buses.troll(), "Plant", [file])).items():
        if path == "EL6751_2.mo":
            assert parse(text.decode()) is not None
        if path.endswith(".h"):
            assert re.search(r'ecatm_can_signal_open\(block->message_1, "[ -~]*"', text.decode())


def test_a_damaged_memory_is_refused(read: Callable[..., can.CanFile]) -> None:
    good = can.dump([read(DBC, "ECU")])
    for data in (
        *(None, b"", b"[]", b'{"schema": 1, "files": [{}]}', b"\xff", b"[" * 100_000, good[:-9]),
        good.replace(b'"schema": 1', b'"schema": 2'),
        good.replace(b'"bit_length": 16', b'"bit_length": 99999999999'),
        good.replace(b'"maximum": 3200.0', b'"maximum": 1e999'),
        good.replace(b'"scale": 0.1', b'"scale": NaN'),
        good.replace(b'"start": 7', b'"start": 4000000000'),
        good.replace(b'"length": 8', b'"length": "8"'),
        good.replace(b'"low": 1', b'"low": null'),
        good.replace(b'"name": "Motor"', b'"name": ["Motor"]'),
        good.replace(b'"period_ms": 100000', b'"period_ms": -1'),
    ):
        assert data != good
        with pytest.raises(StateError) as refused:
            can.remembered(data, "can.json")
        names(str(refused.value), "can.json", "give --can again", "--can none")


@pytest.mark.parametrize("damage", ["lost", "damaged", "a folder"])
def test_messages_that_cannot_be_remembered_are_not_dropped(
    tmp_path: Path, read: Callable[..., can.CanFile], bus: Bus, damage: str
) -> None:
    generate(bus, "Plant", tmp_path, messages=[read(DBC, "ECU")])
    memory = tmp_path / "Plant" / "Resources" / "can.json"
    memory.unlink()
    if damage == "damaged":
        memory.write_text("{")
    if damage == "a folder":
        memory.mkdir()
    before = (tmp_path / "Plant" / "EL6751_2.mo").read_bytes()
    for check in (True, False):
        with pytest.raises(StateError) as refused:
            generate(bus, "Plant", tmp_path, check=check)
        names(str(refused.value), "can.json", "give --can again")
    assert (tmp_path / "Plant" / "EL6751_2.mo").read_bytes() == before
    generate(bus, "Plant", tmp_path, messages=[read(DBC, "ECU")], force=True)
    assert can.parse(memory.read_bytes())
    assert not generate(bus, "Plant", tmp_path, check=True).is_change


def test_a_slave_that_is_no_terminal(tmp_path: Path, bus: Bus) -> None:
    (tmp_path / "x.dbc").write_text(DBC)
    with pytest.raises(UsageError) as refused:
        can.read_request(can.parse_option(f"0={tmp_path}/x.dbc"), bus)
    names(str(refused.value), "--can 0", "no CAN terminal", "[slave.can]")
    with pytest.raises(UsageError) as refused:
        generate_ls_bus(bus, "Plant", tmp_path, 0)
    names(str(refused.value), "--ls-bus 0", "no CAN terminal", "[slave.can]")
    assert not (tmp_path / "Plant.fmu").exists()


def is_refused_with_a_sentence(text: str, name: str, who: str) -> None:
    """If a file cannot be read, one line says so; any other failure fails the test."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / name
        file.write_bytes(text.encode("utf-8", "replace"))
        said = ""
        try:
            found = can.read_request(can.parse_option(f"7={file}@{who}"), sample_buses.troll())
            render(build_library(sample_buses.troll(), "Plant", [found]))
        except EcatError as error:
            said = str(error)
    assert "\n" not in said


@settings(max_examples=150, deadline=None)
@given(st.integers(0, len(DBC) - 1), st.integers(1, 40), st.text(max_size=12))
def test_damaged_dbc_files(at: int, length: int, text: str) -> None:
    is_refused_with_a_sentence(DBC[:at] + text + DBC[at + length :], "x.dbc", "ECU")


@settings(max_examples=100, deadline=None)
@given(st.integers(0, len(DRIVE) - 1), st.integers(1, 40), st.text(max_size=12))
def test_damaged_eds_files(at: int, length: int, text: str) -> None:
    is_refused_with_a_sentence(DRIVE[:at] + text + DRIVE[at + length :], "x.eds", "5")
