"""Saved scans: the same bytes for the same bus, and no file from outside does any harm."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from bus_strategies import buses
from hypothesis import given
from hypothesis import strategies as st

from conftest import names, naming
from ecatd.base.errors import UsageError
from ecatd.description import bus_file
from ecatd.description.bus import Bus, Domain
from ecatd.description.bus_reader import read_bus
from ecatd.etg.datatypes import DataType
from ecatd.operations.encoding import MAX_REPLY, pack, unpack
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
        (("schema",), 2, "schema 2 | schema 1 | scan"),
        (("slaves",), OMITTED, "bus description | 'ecatctl scan -o bus.json'"),
        (("slaves",), {}, "slaves | {} | list"),
        (("name",), "a b", "name | 'a b' | 31"),
        (("name",), OMITTED, "'name'"),
        (("cycle_time_us",), 0, "cycle_time_us | 0 | 1 | 1000000"),
        (("cycle_time_us",), True, "cycle_time_us | True | whole number"),
        (("fingerprint",), "00", "fingerprint | '00'"),
        (("domains", 1, "phase"), 4, "domains[1].phase | 4 | divider"),
        (("slaves", 4, "domain"), 2, "slaves[4].domain | 2 domains | 0 | 1"),
        (("slaves", 2, "position"), 3, "slaves[2].position | 3"),
        (("slaves", 2), [], "slaves[2] | [] | map"),
        (("slaves", 2, "a\nb"), "x", "slaves[2] | 'a\\nb' | position"),
        (("slaves", 2, "coe"), 1, "slaves[2].coe | 1 | true | false"),
        (("slaves", 2, "dc_bits"), 16, "slaves[2].dc_bits | 16 | 32 | 64"),
        (("slaves", 2, "name"), "x" * 5000, "slaves[2].name | 5000 | 4096"),
        ((*ENTRY, "scale"), 0, f"{ENTRY_PLACE}.scale | 0"),
        ((*ENTRY, "scale"), 10**400, f"{ENTRY_PLACE}.scale"),
        ((*ENTRY, "offset"), None, f"{ENTRY_PLACE}.offset | None | finite"),
        ((*ENTRY, "safe"), [], f"{ENTRY_PLACE}.safe | [] | finite"),
        (
            (*ENTRY, "data_type"),
            int(DataType.REAL64),
            f"{ENTRY_PLACE}.bit_length | 32 | REAL64 | 64",
        ),
        ((*ENTRY, "name"), ["x"] * 99, f"{ENTRY_PLACE}.name"),
    ],
)
def test_wrong_files_are_named_with_the_place(
    path: tuple[str | int, ...], value: Any, message: str
) -> None:
    with pytest.raises(UsageError) as caught:
        bus_file.parse(changed(path, value), "bus.json")
    assert str(caught.value).startswith("bus.json: ")
    names(caught.value, *message.split(" | "))
    assert len(str(caught.value)) < 400


def test_a_minimum_above_the_maximum() -> None:
    data = json.loads(changed((*ENTRY, "minimum"), 3))
    data["slaves"][0]["outputs"][0]["entries"][0]["maximum"] = 2
    with pytest.raises(UsageError, match=naming(f"{ENTRY_PLACE}.minimum", 3, "maximum", 2)):
        read_bus(data, "x")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "bus.json:1: | JSON"),
        ('{\n"schema": 1,\n', "bus.json:3: | JSON"),
        ('{"schema": NaN, "slaves": []}', "NaN | number"),
        ('{"schema": 1, "name": "a", "name": "b"}', "'name' | twice"),
        ("[" * 100_000, "nested"),
        ("[]", "bus description"),
        ('{"schema": 1, "slaves": ' + "9" * 5000 + "}", "JSON"),
    ],
)
def test_what_is_no_description(text: str, message: str) -> None:
    with pytest.raises(UsageError, match=naming("bus.json", *message.split(" | "))):
        bus_file.parse(text, "bus.json")


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    (tmp_path / "latin").write_bytes(b"{\xff}")
    with (tmp_path / "large").open("wb") as large:
        large.truncate(1 << 27)
    for name, message in (
        ("none", "none: | No such file"),
        (".", "Is a directory"),
        ("latin", "latin:1: | UTF-8"),
        ("large", "large: | 134217728 | 67108864"),
    ):
        with pytest.raises(UsageError, match=naming(*message.split(" | "))):
            bus_file.load(tmp_path / name)


def test_a_newer_daemon_may_say_more_than_we_know() -> None:
    answer = wired(troll()) | {"colour": "red"}
    answer["slaves"][0]["weight"] = 5
    assert read_bus(answer, "the answer of the daemon", strict=False) == troll()
    with pytest.raises(UsageError, match=naming("slaves[0]", "'weight'")):
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


@pytest.mark.long
@given(buses)
def test_every_bus_survives(bus: Bus) -> None:
    assert bus_file.parse(bus_file.dump(bus), "x") == bus
    assert read_bus(wired(bus), "x") == bus
