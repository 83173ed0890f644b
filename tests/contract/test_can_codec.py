"""Bits of CAN signals: cantools is the judge."""

from __future__ import annotations

import math
import struct
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from cantools.database import Message, Signal
from cantools.database.conversion import BaseConversion
from hypothesis import given, settings
from hypothesis import strategies as st

from conftest import names
from ecatgen import static_library

SOURCES = Path(__file__).parents[2] / "client_c"
UNSIGNED, SIGNED, FLOAT = 1, 2, 3
NONE = (0, 0, 0, 0, 0)


class Codec:
    """The program can_codec.c, running."""

    def __init__(self, program: Path) -> None:
        self.process = subprocess.Popen(
            [str(program)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def ask(self, command: str, signal: tuple[Any, ...], data: bytes, value: object = "") -> str:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        text = " ".join(map(str, signal))
        self.process.stdin.write(f"{command} {text} {data.hex()} {value}\n")
        self.process.stdin.flush()
        return self.process.stdout.readline().strip()

    def close(self) -> None:
        self.process.kill()
        self.process.communicate()


@pytest.fixture(scope="module")
def codec(tmp_path_factory: pytest.TempPathFactory, compiler: str) -> Iterator[Codec]:
    program = tmp_path_factory.mktemp("codec") / "codec"
    client = static_library.built_folder("_client", "the client")
    (archive,) = client.rglob("libecat.a")
    done = subprocess.run(
        [
            *(compiler, "-std=c11", "-D_GNU_SOURCE", "-Wall", "-Wextra", "-Werror", "-O1"),
            *(f"-I{SOURCES / 'include'}", f"-I{SOURCES / 'src'}"),
            *(str(Path(__file__).with_name("can_codec.c")), str(archive), "-lm", "-pthread"),
            *("-o", str(program)),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    running = Codec(program)
    yield running
    running.close()


@st.composite
def signals(draw: st.DrawFn) -> Signal:
    kind = draw(st.sampled_from(["unsigned", "signed", "float"]))
    length = draw(st.sampled_from([32, 64]) if kind == "float" else st.integers(1, 64))
    big_endian = draw(st.booleans())
    first = draw(st.integers(0, 64 - length))
    start = 8 * (first // 8) + 7 - first % 8 if big_endian else first
    return Signal(
        name="s",
        start=start,
        length=length,
        byte_order="big_endian" if big_endian else "little_endian",
        is_signed=kind != "unsigned",
        conversion=BaseConversion.factory(
            scale=draw(st.sampled_from([1, 0.1, -0.25, 1e-3, 3.7])),
            offset=draw(st.sampled_from([0, -40, 0.5])),
            is_float=kind == "float",
        ),
    )


def described(signal: Signal, unit: str = "u") -> tuple[Any, ...]:
    number = FLOAT if signal.is_float else SIGNED if signal.is_signed else UNSIGNED
    return (
        *(signal.start, signal.length, int(signal.byte_order == "big_endian"), number),
        *(signal.scale, signal.offset, -1e300, 1e300, unit, *NONE),
    )


def judge(signal: Signal) -> Message:
    return Message(frame_id=1, name="m", length=8, signals=[signal], strict=True)


def same(one: float, other: float) -> bool:
    """Whether two numbers are the same but for the last bit, as cantools adds integers exactly."""
    return math.isclose(one, other, rel_tol=2.3e-16) or (math.isnan(one) and math.isnan(other))


@settings(max_examples=400, deadline=None)
@given(signals(), st.binary(min_size=8, max_size=8))
def test_the_value_of_a_frame(codec: Codec, signal: Signal, data: bytes) -> None:
    real, whole = codec.ask("d", described(signal), data).split()
    expected = judge(signal).decode(data, decode_choices=False)["s"]
    assert isinstance(expected, int | float)
    assert same(float(real), float(expected))
    if not signal.is_float:
        raw = judge(signal).decode(data, decode_choices=False, scaling=False)["s"]
        assert int(whole) == (raw if raw < 1 << 63 else raw - (1 << 64))


@settings(max_examples=400, deadline=None)
@given(signals(), st.data())
def test_the_frame_of_a_value(codec: Codec, signal: Signal, data: st.DataObject) -> None:
    bits = signal.length
    if signal.is_float:
        width = bits
        raw = data.draw(st.floats(allow_nan=False, allow_infinity=False, width=width), "raw")
        value = raw * signal.scale + signal.offset
        # The value that is sent is the nearest one to what the division gives.
        sent = (value - signal.offset) / signal.scale
        if abs(sent) > struct.unpack("<f", b"\xff\xff\x7f\x7f")[0] or math.isinf(sent):
            return
        expected = judge(signal).encode({"s": sent}, scaling=False)
    else:
        low, high = (
            (-(1 << bits - 1), (1 << bits - 1) - 1) if signal.is_signed else (0, 2**bits - 1)
        )
        raw = data.draw(st.integers(max(low, -(2**40)), min(high, 2**40)), "raw")
        value = raw * signal.scale + signal.offset
        expected = judge(signal).encode({"s": raw}, scaling=False)
    assert codec.ask("r", described(signal), bytes(8), repr(float(value))) == expected.hex()


@settings(max_examples=200, deadline=None)
@given(signals(), st.data())
def test_whole_numbers_keep_all_bits(codec: Codec, signal: Signal, data: st.DataObject) -> None:
    if signal.is_float:
        return
    bits = signal.length
    low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if signal.is_signed else (0, 2**bits - 1)
    raw = data.draw(st.integers(low, high), "raw")
    plain = (*described(signal, "-")[:4], 1, 0, *described(signal, "-")[6:])
    given_value = raw if raw < 1 << 63 else raw - (1 << 64)
    expected = judge(signal).encode({"s": raw}, scaling=False)
    assert codec.ask("w", plain, bytes(8), given_value) == expected.hex()


@settings(max_examples=100, deadline=None)
@given(signals(), st.binary(min_size=8, max_size=8))
def test_other_bits_stay(codec: Codec, signal: Signal, data: bytes) -> None:
    if signal.is_float:
        return
    plain = (*described(signal, "-")[:4], 1, 0, *described(signal, "-")[6:])
    whole = codec.ask("d", plain, data).split()[1]
    assert codec.ask("w", plain, data, whole) == data.hex()


def test_limits(codec: Codec) -> None:
    cut = (0, 16, 0, SIGNED, 0.1, 0.0, -1.5, 0.3, "V", *NONE)
    assert codec.ask("r", cut, bytes(8), "2") == struct.pack("<h6x", 3).hex()
    assert codec.ask("r", cut, bytes(8), "-2") == struct.pack("<h6x", -15).hex()
    assert codec.ask("r", cut, bytes(8), "0.26") == struct.pack("<h6x", 3).hex()
    refused = (0, 16, 0, SIGNED, 1, 0.0, -5, 5, "-", *NONE)
    names(codec.ask("r", refused, bytes(8), "6"), "6", "signal s", "-5 to 5", "0x0")
    names(codec.ask("r", refused, bytes(8), "nan"), "nan", "signal s")


@pytest.mark.parametrize(
    ("signal", "words"),
    [
        ((57, 8, 0, UNSIGNED, 1, 0, 0, 1, "-", *NONE), ["start bit 57", "8 bits"]),
        ((0, 65, 0, UNSIGNED, 1, 0, 0, 1, "-", *NONE), ["65 bits"]),
        ((63, 2, 0, UNSIGNED, 1, 0, 0, 1, "-", *NONE), ["start bit 63"]),
        ((56, 2, 1, UNSIGNED, 1, 0, 0, 1, "-", *NONE), ["start bit 56"]),
        ((0, 8, 0, UNSIGNED, 0, 0, 0, 1, "-", *NONE), ["scale", "other than 0"]),
        ((0, 16, 0, FLOAT, 1, 0, 0, 1, "-", *NONE), ["32 or 64"]),
        ((0, 8, 0, UNSIGNED, 1, 0, 2, 1, "-", *NONE), ["minimum", "maximum"]),
        ((0, 8, 0, UNSIGNED, 1, 0, 0, 1, "-", 60, 8, 0, 0, 1), ["within the data"]),
    ],
)
def test_what_no_frame_has(codec: Codec, signal: tuple[Any, ...], words: list[str]) -> None:
    answer = codec.ask("d", signal, bytes(8))
    assert "signal s" in answer
    for word in words:
        assert word in answer


@pytest.mark.parametrize(
    ("data", "length", "is_received"),
    [
        ("0133000000000000", 8, 1),
        ("0133", 2, 0),  # it has the signal, which needs 4 bytes
        ("01330000", 4, 1),
        ("0033", 2, 1),  # it does not have the signal
        ("00", 1, 1),
        ("", 0, 0),  # nothing says whether it has it
    ],
)
def test_a_frame_needs_the_bytes_of_the_signals_that_it_has(
    codec: Codec, data: str, length: int, is_received: int
) -> None:
    selected = (8, 24, 0, UNSIGNED, 1, 0, -1e300, 1e300, "u", 0, 8, 0, 1, 1)
    padded = bytes.fromhex(data).ljust(8, b"\0")
    assert codec.ask("l", selected, padded, length) == str(is_received)
