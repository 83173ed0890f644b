"""Saved scans: the same bytes for the same bus, and no file from outside does any harm."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from bus_strategies import buses
from hypothesis import given
from hypothesis import strategies as st

from ecatd.encoding import MAX_REPLY, pack, unpack
from ecatd.model import bus_file
from ecatd.model.bus import Bus, Domain
from ecatd.model.bus_reader import read_bus
from ecatd.model.datatypes import DataType
from ecatd.model.errors import UsageError
from ecatdev import sample_buses


def troll() -> Bus:
    bus = sample_buses.troll()
    bus.domains = [Domain(), Domain("slow", 4, 3)]
    bus.slaves[4] = replace(
        bus.slaves[4], domain=1, serial=7, alias=5, address=0x1001, dc_bits=64, dc_delay_ns=310
    )
    bus.slaves[0].outputs[0].entries[0].safe = "hold"
    bus.slaves[0].outputs[0].entries[1].minimum = -2.5
    return bus


def wired(bus: Bus) -> dict[str, Any]:
    """The description as it comes from a daemon."""
    return unpack(pack(bus.to_dict()), MAX_REPLY)


def test_a_description_survives_the_file_and_the_wire() -> None:
    bus = troll()
    text = bus_file.dump(bus, "1.2.3")
    assert json.loads(text)["version"] == "1.2.3"
    assert bus_file.parse(text, "x") == bus
    assert bus_file.dump(bus_file.parse(text, "x"), "1.2.3") == text
    assert read_bus(wired(bus), "x") == bus
    assert bus_file.dump(read_bus(wired(bus), "x")) == bus_file.dump(bus)


def test_every_entry_has_a_line_of_its_own() -> None:
    lines = bus_file.dump(troll()).splitlines()
    entries = [line for line in lines if '"bit_length"' in line]
    assert len(entries) == sum(
        len(pdo.entries) for slave in troll().slaves for pdo in slave.outputs + slave.inputs
    )
    # Named values and notes are as long as they are.
    short = [line for line in entries if '"values"' not in line and '"note"' not in line]
    assert len(short) > 100
    assert all(len(line) < 250 for line in short)


def test_a_bus_without_slaves() -> None:
    assert bus_file.parse(bus_file.dump(Bus("x", 1000)), "x") == Bus("x", 1000)


ENTRY = ("slaves", 0, "outputs", 0, "entries", 0)
ENTRY_PLACE = "slaves[0].outputs[0].entries[0]"
OMITTED: Any = object()


def changed(path: tuple[str | int, ...], value: Any) -> str:
    """The file of `troll` with another value somewhere."""
    data = json.loads(bus_file.dump(troll()))
    place = data
    for key in path[:-1]:
        place = place[key]
    if value is OMITTED:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    if path != ("fingerprint",):
        del data["fingerprint"]
    return json.dumps(data)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("schema",), 2, "has schema 2, but this version reads schema 1: scan the bus again"),
        (("schema",), OMITTED, "has schema None"),
        (("slaves",), OMITTED, "is no bus description: make one with 'ecatctl scan -o bus.json'"),
        (("slaves",), {}, "slaves is {}, but must be a list"),
        (("name",), "a b", "name is 'a b', but a bus name has 1 to 31 letters"),
        (("name",), OMITTED, "has no key 'name'"),
        (("cycle_time_us",), 0, "cycle_time_us is 0, but must be from 1 to 1000000"),
        (("cycle_time_us",), True, "cycle_time_us is True, but must be a whole number"),
        (("fingerprint",), "00", "fingerprint is '00', but that of these slaves is "),
        (("domains", 1, "phase"), 4, "domains[1].phase is 4, but must be less than the divider, 4"),
        (("slaves", 4, "domain"), 2, "slaves[4].domain is 2, but there are 2 domains, 0 to 1"),
        (("slaves", 2, "position"), 3, "slaves[2].position is 3, but slaves follow each other"),
        (("slaves", 2), [], "slaves[2] is [], but must be a map"),
        (
            ("slaves", 2, "nmae"),
            "x",
            "slaves[2] has the key 'nmae', but only position, name, vendor",
        ),
        (("slaves", 2, "a\nb"), "x", "slaves[2] has the key 'a\\nb', but only"),
        (("slaves", 2, "vendor"), 1 << 32, "vendor is 4294967296, but must be from 0 to 4294967"),
        (("slaves", 2, "vendor"), "2", "slaves[2].vendor is '2', but must be a whole number"),
        (("slaves", 2, "vendor"), OMITTED, "slaves[2] has no key 'vendor'"),
        (("slaves", 2, "coe"), 1, "slaves[2].coe is 1, but must be true or false"),
        (("slaves", 2, "dc_bits"), 16, "dc_bits is 16, but a clock has 32 or 64 bits"),
        (("slaves", 2, "name"), "x" * 5000, "name has 5000 characters, but 4096 are allowed"),
        ((*ENTRY, "index"), -1, f"{ENTRY_PLACE}.index is -1, but must be from 0 to 65535"),
        ((*ENTRY, "bit_length"), 256, f"{ENTRY_PLACE}.bit_length is 256, but must be from 0 to"),
        ((*ENTRY, "scale"), 0, f"{ENTRY_PLACE}.scale is 0, but a scale is not"),
        ((*ENTRY, "scale"), 10**400, f"{ENTRY_PLACE}.scale is 1000"),
        ((*ENTRY, "offset"), None, f"{ENTRY_PLACE}.offset is None, but must be a finite number"),
        ((*ENTRY, "safe"), "stop", f"{ENTRY_PLACE}.safe is 'stop', but must be a finite number"),
        ((*ENTRY, "safe"), [], f"{ENTRY_PLACE}.safe is [], but must be a finite number"),
        ((*ENTRY, "data_type"), int(DataType.REAL64), "bit_length is 32, but REAL64 has 64 bits"),
        ((*ENTRY, "name"), ["x"] * 99, f"{ENTRY_PLACE}.name is ['x', 'x', 'x', 'x'"),
    ],
)
def test_wrong_files_are_named_with_the_place(
    path: tuple[str | int, ...], value: Any, message: str
) -> None:
    with pytest.raises(UsageError) as caught:
        bus_file.parse(changed(path, value), "bus.json")
    assert str(caught.value).startswith("bus.json: ")
    assert message in str(caught.value)
    assert len(str(caught.value)) < 400


def test_a_minimum_above_the_maximum() -> None:
    data = json.loads(changed((*ENTRY, "minimum"), 3))
    data["slaves"][0]["outputs"][0]["entries"][0]["maximum"] = 2
    with pytest.raises(UsageError, match=r"minimum is 3, more than the maximum, 2"):
        read_bus(data, "x")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", ":1: is no valid JSON"),
        ('{\n"schema": 1,\n', ":3: is no valid JSON"),
        ('{"schema": NaN, "slaves": []}', "NaN is no number in JSON"),
        ('{"schema": 1, "name": "a", "name": "b"}', "the key 'name' occurs twice"),
        ("[" * 100_000, "is nested too deeply"),
        ("[]", "is no bus description"),
        ('{"schema": 1, "slaves": ' + "9" * 5000 + "}", "is no valid JSON"),
    ],
)
def test_what_is_no_description(text: str, message: str) -> None:
    with pytest.raises(UsageError, match=re.escape(message)):
        bus_file.parse(text, "bus.json")


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    (tmp_path / "latin").write_bytes(b"{\xff}")
    with (tmp_path / "large").open("wb") as large:
        large.truncate(1 << 27)
    for name, message in (
        ("none", "none: cannot be read: No such file"),
        (".", "cannot be read: Is a directory"),
        ("latin", "latin:1: is no UTF-8 text"),
        ("large", "has 134217728 bytes, but at most 67108864 are read"),
    ):
        with pytest.raises(UsageError, match=message):
            bus_file.load(tmp_path / name)


def test_a_newer_daemon_may_say_more_than_we_know() -> None:
    answer = wired(troll()) | {"colour": "red"}
    answer["slaves"][0]["weight"] = 5
    assert read_bus(answer, "the answer of the daemon", strict=False) == troll()
    with pytest.raises(UsageError, match=r"slaves\[0\] has the key 'weight'"):
        read_bus(answer, "bus.json")


numbers = st.integers(0, 0xFFFF) | st.integers(-(1 << 70), 1 << 70) | st.floats()
junk = st.recursive(
    st.none() | st.booleans() | numbers | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=5,
)


def places(value: Any, here: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    inside = value.items() if isinstance(value, dict) else enumerate(value)
    found = [here] if here else []
    if isinstance(value, dict | list):
        for key, item in inside:
            found += places(item, (*here, key)) if isinstance(item, dict | list) else [(*here, key)]
    return found


PLACES = places(json.loads(bus_file.dump(troll())))


def taken(text: str) -> Bus | None:
    """The bus, or None where one sentence says why it is none."""
    message = ""
    try:
        return bus_file.parse(text, "bus.json")
    except UsageError as error:
        message = str(error)
    assert message.startswith("bus.json")
    assert "\n" not in message
    return None


@given(st.sampled_from(PLACES), junk | st.just(OMITTED))
def test_whatever_a_file_says_it_is_a_bus_or_refused(
    path: tuple[str | int, ...], value: Any
) -> None:
    if path == ("fingerprint",):
        return
    bus = taken(changed(path, value))
    if bus is not None:
        assert bus_file.parse(bus_file.dump(bus), "again") == bus


@given(st.binary(max_size=60), st.integers(0, 4000), st.integers(0, 60))
def test_damaged_files(data: bytes, at: int, cut: int) -> None:
    text = bus_file.dump(troll())
    damaged = text[:at] + data.decode("latin-1") + text[at + cut :]
    taken(damaged)


@given(buses)
def test_every_bus_survives(bus: Bus) -> None:
    assert bus_file.parse(bus_file.dump(bus), "x") == bus
    assert read_bus(wired(bus), "x") == bus
