"""`[slave.can]`: what is taken, what a terminal is told, and what is said of what does not fit."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from conftest import names, names_at, without_notes
from ecatd.base.errors import ConfigError
from ecatd.config import CanSafeConfig, Config, SlaveCanConfig, load_config, read_config
from ecatd.config.differences import differences
from ecatd.config.profiles import load_profiles
from ecatd.config.resolve import (
    CanChannel,
    SafeFrame,
    can_change,
    can_channels,
    misfits,
    with_can_objects,
)
from ecatd.config.writer import write_config
from ecatd.description.bus import Bus, Slave
from ecatd.etg.can_terminals import EL6751, ESD, KENDRION, PROFILE_11, PROFILE_29, Mode
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo

HEAD = "[[slave]]\nposition = 0\nname = 'can'\n[slave.can]\n"
"""Four lines in front of the keys."""


def load(tmp_path: Path, text: str) -> Config:
    file = tmp_path / "ecat0.toml"
    file.write_text(text)
    return load_config(file)


def of_bytes(index: int, manager: int, size: int) -> Pdo:
    return Pdo(index, "", manager, [Entry(0x6000, 1, "", DataType.OCTET_STRING, 8 * size)])


def terminal(inputs: int = 0, outputs: int = 0) -> Slave:
    """EL6751 with process data of so many bytes."""
    slave = Slave(0, "EL6751", EL6751.vendor, EL6751.product or 0, 1, coe=True)
    slave.inputs = [of_bytes(0x1A00, 3, inputs)] if inputs else []
    slave.outputs = [of_bytes(0x1600, 2, outputs)] if outputs else []
    return slave


def made_bus(slave: Slave) -> Bus:
    return Bus("b", 1000, [slave])


def channel(config: Config, slave: Slave) -> CanChannel:
    """The channel of slave 0; its process data are not looked at."""
    (found,) = can_channels(config, made_bus(slave), [0])
    return found


def test_all_keys(tmp_path: Path) -> None:
    """They survive as maps, in a file that is written, and in a comparison with itself."""
    config = load(
        tmp_path,
        f"""{HEAD}
        bit_rate = 500
        layout = "el6751"
        identifiers = 29
        mode = "buffered"
        sample_point = 87
        frames_per_second = 3000
        receive_queue = 20
        send_queue = 16
        filters = [0x181, "0x200-0x27f", "385 - 0x1ff"]
        flags = 8
        bus_off_restart_ms = 2000
        [[slave.can.safe]]
        id = 0
        data = "02 00"
        [[slave.can.safe]]
        id = 0x18FF0001
        data = "00"
        period_ms = 100
        identifiers = ["0x18FF0000-0x18FF00FF"]
        when = "ended"
        [[slave.can.safe]]
        id = 5
        extended = true
        remote = true
        """,
    )
    (slave,) = config.slave
    assert slave.can == SlaveCanConfig(
        500,
        "el6751",
        29,
        "buffered",
        87.0,
        3000,
        20,
        16,
        ["0x181", "0x200-0x27F", "0x181-0x1FF"],
        8,
        2000,
        [
            CanSafeConfig(0, data="02 00"),
            CanSafeConfig(
                0x18FF0001,
                data="00",
                period_ms=100,
                identifiers=["0x18FF0000-0x18FF00FF"],
                when="ended",
            ),
            CanSafeConfig(5, True, True),
        ],
    )
    assert slave.writes_objects
    assert read_config(json.loads(json.dumps(config.to_dict()))) == config
    found = channel(config, terminal())
    assert found.filters == ((0x181, 0x181), (0x200, 0x27F), (0x181, 0x1FF))
    assert found.safe == (
        SafeFrame(0, False, False, b"\2\0", 0, (), False),
        SafeFrame(0x18FF0001, True, False, b"\0", 100, ((0x18FF0000, 0x18FF00FF),), True),
        SafeFrame(5, True, True, b"", 0, (), False),
    )
    written = tmp_path / "written.toml"
    written.write_text(write_config(config, made_bus(terminal()), "1.0"))
    again = load_config(written)
    assert again.slave[0].can == slave.can
    assert not differences(again, again).found


def test_a_changed_key_and_an_added_frame_are_differences(tmp_path: Path) -> None:
    """Each by the table and what it is about."""
    before = load(tmp_path, f"{HEAD}bit_rate = 500\n")
    safe = "[[slave.can.safe]]\nid = 0\ndata = '02 00'\n"
    after = load(tmp_path, f"{HEAD}bit_rate = 250\n{safe}")
    found = {item.key: (item.before, item.after) for item in differences(before, after).found}
    assert found["slave[can].can.bit_rate"] == (500, 250)
    assert found["slave[can].can.safe[0x0000]"][0] is None


def test_a_configuration_that_is_written_offers_the_table(tmp_path: Path) -> None:
    """For a terminal whose identity is known."""
    text = write_config(load(tmp_path, ""), made_bus(terminal()), "1.0")
    assert "# [slave.can]" in text


WRONG = [
    ("", ":4: slave[0].can.bit_rate:", "missing"),
    ("bit_rate = 2000", ":5: slave[0].can.bit_rate:", "2000 | 1000"),
    ("bit_rate = 500\nidentifiers = 12", ":6: slave[0].can.identifiers:", "12 | 11 | 29"),
    ("bit_rate = 500\nmode = 'quick'", ":6: slave[0].can.mode:", '"buffered"'),
    ("bit_rate = 500\nlayout = 'EL6751'", ":6: slave[0].can.layout:", '"el6751"'),
    (
        "bit_rate = 500\nmode = 'fast'\nidentifiers = 29",
        ":7: slave[0].can.identifiers:",
        '"fast" | 11 bit | "buffered"',
    ),
    (
        "bit_rate = 500\nmode = 'fast'\nfilters = [1]",
        ":7: slave[0].can.filters:",
        '"fast" | "buffered"',
    ),
    ("bit_rate = 500\nfilters = ['a']", ":6: slave[0].can.filters[0]:", "'a' | 0x1FFFFFFF"),
    ("bit_rate = 500\nfilters = ['5-4']", ":6: slave[0].can.filters[0]:", "'5-4'"),
    ("bit_rate = 500\nfilters = [true]", ":6: slave[0].can.filters[0]:", "true"),
    (
        "bit_rate = 500\nidentifiers = 11\nfilters = ['0x700-0x800']",
        ":7: slave[0].can.filters:",
        "0x700 | 0x800 | 0x7FF",
    ),
    ("bit_rate = 500\nframes_per_second = 'all'", ":6: slave[0].can.frames_per_second:", '"full"'),
    (
        "bit_rate = 500\n[[slave.can.safe]]\nid = 0x800\nextended = false",
        ":7: slave[0].can.safe[0].id:",
        "0x800 | 29 bit",
    ),
    (
        "bit_rate = 500\nidentifiers = 11\n[[slave.can.safe]]\nid = 0x800",
        ":8: slave[0].can.safe[0].id:",
        "0x800 | 29 bit | 11 bit",
    ),
    (
        "bit_rate = 500\n[[slave.can.safe]]\nid = 1\nremote = true\ndata = '00'",
        ":9: slave[0].can.safe[0].data:",
        "remote",
    ),
    (
        "bit_rate = 500\n[[slave.can.safe]]\nid = 1\ndata = '0x1'",
        ":8: slave[0].can.safe[0].data:",
        "'0x1' | hexadecimal",
    ),
    (
        "bit_rate = 500\n[[slave.can.safe]]\nid = 1\ndata = '" + "00 " * 9 + "'",
        ":8: slave[0].can.safe[0].data:",
        "9 bytes | 8",
    ),
    ("bit_rate = 500\nbaudrate = 1", ":6: slave[0].can.baudrate:", "is not a key"),
]


@pytest.mark.parametrize(("text", "where", "what"), WRONG)
def test_wrong_keys(tmp_path: Path, text: str, where: str, what: str) -> None:
    """They are refused when the file is read, with the place and what is allowed."""
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, HEAD + text)
    assert str(tmp_path / "ecat0.toml") + where in without_notes(caught.value)
    names(caught.value, *what.split(" | "))


def test_a_terminal_is_told_its_settings_before_all_else(tmp_path: Path) -> None:
    """As start-up parameters in PREOP, before the PDOs are assigned."""
    text = f"{HEAD}bit_rate = 250\nreceive_queue = 12\nsend_queue = 9\n"
    config = load(tmp_path, text + "[[slave.startup]]\nobject = '0x1C32:01'\nhex = '01 00'\n")
    settings = with_can_objects(config, config.slave[0], terminal())
    *own, last = settings.startup
    assert last.object == "0x1C32:01"
    assert {item.transition for item in own} == {"IP"}
    assert {item.comment for item in own} == {"[slave.can]"}
    told = {item.object: item.text for item in own}
    assert told["0xF800:00"] == "17"
    assert told["0xF800:02"] == "3"
    assert told["0xF800:04"] == "1000"
    assert told["0x8000:20"] == "8"
    assert told["0x8000:21"] == "12"
    assert told["0x8000:22"] == "9"
    assert told["0x8001:00"] == "01 00 00 00 00 00 FF FF FF 1F"
    assert own[0].object == "0xF800:00"
    assert own[0].data == b"\0"
    assert settings.remapped >= {0x1600, 0x1A00}
    raw = {item.object: item.data for item in own if not item.object.endswith(":00")}
    assert raw["0xF800:04"] == b"\xe8\3\0\0"


def test_identifiers_of_11_bit_and_filters(tmp_path: Path) -> None:
    """The filters are written at once, as ranges."""
    text = "bit_rate = 125\nidentifiers = 11\nfilters = ['0x180-0x1FF', 0x701]\n"
    config = load(tmp_path, HEAD + text)
    told = {
        item.object: item.text
        for item in with_can_objects(config, config.slave[0], terminal()).startup
    }
    assert told["0x8000:20"] == "0"
    assert told["0x8001:00"] == "02 00 80 01 00 00 FF 01 00 00 01 07 00 00 01 07 00 00"
    found = channel(config, terminal())
    assert (found.identifiers, found.layout) == (11, PROFILE_11)


def test_a_fast_mode(tmp_path: Path) -> None:
    """It needs flags that no source says, has no filters, and queues for one cycle."""
    config = load(tmp_path, f"{HEAD}bit_rate = 500\nmode = 'fast'\nflags = 0x10\n")
    found = channel(config, terminal())
    assert (found.mode, found.identifiers, found.layout) == (Mode.FAST, 11, PROFILE_11)
    assert (found.receive_queue, found.send_queue, found.remarks) == (11, 11, ())
    objects = [item.index for item in EL6751.written(found.settings)]
    assert 0x8001 not in objects
    assert not found.mode.acknowledged


@pytest.mark.parametrize(
    ("text", "receive", "send", "remarked"),
    [
        ("bit_rate = 100", 11, 11, False),
        ("bit_rate = 500", 32, 32, True),
        ("bit_rate = 500\nframes_per_second = 2000", 10, 10, False),
        ("bit_rate = 500\nreceive_queue = 10", 10, 10, True),
        ("bit_rate = 500\nreceive_queue = 12\nsend_queue = 3", 12, 3, True),
        ("bit_rate = 1000\nframes_per_second = 6400", 32, 32, False),
    ],
)
def test_queues_are_long_enough(
    tmp_path: Path, text: str, receive: int, send: int, remarked: bool
) -> None:
    """For a full bus as far as the terminal can, or for what is asked for."""
    found = channel(load(tmp_path, HEAD + text), terminal())
    assert (found.receive_queue, found.send_queue) == (receive, send)
    assert bool(found.remarks) == remarked


def test_the_remark_says_what_the_queues_carry(tmp_path: Path) -> None:
    """And what to write if that is enough, or is not."""
    found = channel(load(tmp_path, f"{HEAD}bit_rate = 500\n"), terminal())
    (remark,) = found.remarks
    names(remark, "slave[0].can.bit_rate", 6400, 10638, "frames_per_second", "601 µs", '"fast"')


def test_the_cycle_is_that_of_the_domain(tmp_path: Path) -> None:
    """A slow domain needs longer queues."""
    domains = "[[domain]]\n[[domain]]\ndivider = 4\nslaves = ['can']\n"
    text = f"{HEAD}bit_rate = 500\nframes_per_second = 1000\n{domains}"
    found = channel(load(tmp_path, text), terminal())
    assert (found.cycle_us, found.receive_queue) == (4000, 20)
    assert found.settings.cycle_us == 4000


UNFIT = [
    (
        "bit_rate = 500\nframes_per_second = 'full'",
        ":6: slave[0].can.frames_per_second: 10638 | 5 cycles | 1000 µs | 54 | EL6751 | 32 | "
        '601 µs | "fast" | bit_rate = 250 | frames_per_second = 6400',
    ),
    (
        "bit_rate = 1000\nframes_per_second = 9000\nidentifiers = 29",
        ":6: slave[0].can.frames_per_second: 9000 | 45 | 32 | 711 µs | frames_per_second = 6400",
    ),
    (
        "bit_rate = 100\nframes_per_second = 3000",
        ":6: slave[0].can.frames_per_second: 3000 | 100 kbit/s | 2128",
    ),
    (
        "bit_rate = 500\nframes_per_second = 4000\nreceive_queue = 10",
        ":7: slave[0].can.receive_queue: 10 | 4000 | 1000 µs | 20",
    ),
    ("bit_rate = 500\nsend_queue = 33", ":6: slave[0].can.send_queue: 33 | 32 | EL6751"),
    ("bit_rate = 400", ":5: slave[0].can.bit_rate: 400 kbit/s | 10, 20, 50 | 250 | EL6751"),
    (
        "bit_rate = 500\nsample_point = 80",
        ":6: slave[0].can.sample_point: 80 | 87 % | 500 kbit/s | other nodes",
    ),
    (
        "bit_rate = 500\nmode = 'fast'",
        ':4: slave[0].can.flags: "fast" | 0x8000:20 | TwinCAT | EL6751',
    ),
    (
        "bit_rate = 500\n[[slave.startup]]\nobject = '0xF800:02'\ntype = 'uint8'\nvalue = 1",
        ":7: slave[0].startup[0].object: 0xF800:02 | [slave.can] | slave 0 (can, EL6751) | remove",
    ),
    (
        "bit_rate = 500\n[[outputs.safe]]\nslave = 0\nvalue = 'hold'",
        ":7: outputs.safe[0].slave: slave 0 (can, EL6751) | [slave.can]",
    ),
    (
        "bit_rate = 500\nlayout = 'kendrion'\nmode = 'fast'\nflags = 1",
        ':7: slave[0].can.mode: Kendrion Kuhnke FIO CAN (694 411 00) | "buffered"',
    ),
    (
        "bit_rate = 500\nlayout = 'kendrion'\nidentifiers = 11",
        ":7: slave[0].can.identifiers: 29 | 11",
    ),
    ("bit_rate = 500\nlayout = 'kendrion'\nfilters = [1]", ":7: slave[0].can.filters: no filters"),
    ("bit_rate = 500\nlayout = 'kendrion'\nflags = 1", ":7: slave[0].can.flags: no flags"),
    (
        "bit_rate = 500\nlayout = 'kendrion'\nreceive_queue = 8",
        ":7: slave[0].can.receive_queue: 8 | always has 9",
    ),
    (
        "bit_rate = 500\nlayout = 'kendrion'\nsample_point = 80",
        ":7: slave[0].can.sample_point: nothing says | leave this out",
    ),
]


@pytest.mark.parametrize(("text", "message"), UNFIT)
def test_what_a_terminal_cannot_do(tmp_path: Path, text: str, message: str) -> None:
    """It is refused before anything is written, and the terminal's abilities are named."""
    config = load(tmp_path, HEAD + text)
    slave = terminal(12, 12)
    slave.given_name = "can"
    said = misfits(config, made_bus(slave), load_profiles(), [0])
    assert said
    place, key, tokens = message.split(": ", 2)
    names_at(said[0], f"{tmp_path / 'ecat0.toml'}{place}: {key}: {tokens}")
    assert "\n" not in said[0]


def test_a_slave_that_is_no_known_terminal(tmp_path: Path) -> None:
    """The known ones are named, and how to say that it behaves like one of them."""
    other = Slave(0, "IO", 2, 0x07D83052, 1, coe=True)
    with pytest.raises(ConfigError) as caught:
        channel(load(tmp_path, f"{HEAD}bit_rate = 500\n"), other)
    names(caught.value, "slave 0 (IO)", "0x07D83052", '"el6751"', '"esd-c2922"', '"kendrion"')
    names(caught.value, "slave[0].can", "layout")
    found = channel(load(tmp_path, f"{HEAD}bit_rate = 500\nlayout = 'esd-c2922'\n"), other)
    assert (found.terminal, found.layout) == (ESD, PROFILE_29)
    assert not [text for text in found.remarks if "leave layout out" in text]


def test_a_known_terminal_that_is_used_like_another_one(tmp_path: Path) -> None:
    """The file decides, and ecatd says that it does."""
    text = f"{HEAD}bit_rate = 500\nlayout = 'esd-c2922'\nframes_per_second = 1000\n"
    found = channel(load(tmp_path, text), terminal())
    assert found.terminal == ESD
    (remark,) = found.remarks
    names(remark, "slave[0].can.layout", "EL6751", "C.2922", '"esd-c2922"')


def test_a_terminal_needs_coe(tmp_path: Path) -> None:
    """Otherwise nothing can be set in it."""
    mute = terminal()
    mute.coe = False
    with pytest.raises(ConfigError, match="has no CoE"):
        channel(load(tmp_path, f"{HEAD}bit_rate = 500\n"), mute)


def test_a_terminal_that_cannot_be_set(tmp_path: Path) -> None:
    """Nothing is written to it; its process data are compared nevertheless."""
    config = load(tmp_path, f"{HEAD}bit_rate = 500\nlayout = 'kendrion'\n")
    slave = terminal(160, 160)
    assert not with_can_objects(config, config.slave[0], slave).startup
    (found,) = can_channels(config, made_bus(slave))
    assert (found.terminal, found.receive_queue, found.flags) == (KENDRION, 9, 0)
    with pytest.raises(ConfigError) as caught:
        can_channels(config, made_bus(terminal(152, 160)))
    names(caught.value, 152, 160, "[[slave.startup]]")


def test_the_process_data_must_be_those_of_the_layout(tmp_path: Path) -> None:
    """Both lengths are named: nobody is believed alone."""
    config = load(tmp_path, f"{HEAD}bit_rate = 500\nreceive_queue = 10\n")
    (found,) = can_channels(config, made_bus(terminal(154, 166)))
    assert (found.input_bytes, found.output_bytes, found.status_at) == (154, 166, 148)
    with pytest.raises(ConfigError) as caught:
        can_channels(config, made_bus(terminal(148, 166)))
    names_at(
        caught.value,
        f"{tmp_path / 'ecat0.toml'}:4: slave[0].can: slave 0 (EL6751) | 148 bytes | 154 | "
        "166 | receive_queue = 10 | send_queue = 10 | pdos",
    )
    assert can_channels(config, made_bus(terminal(148, 166)), [0])


def test_a_start_that_would_change_the_process_data(tmp_path: Path) -> None:
    """`ecatctl config check` tells it, and does not compare them yet."""
    config = load(tmp_path, f"{HEAD}bit_rate = 500\nreceive_queue = 10\n")
    names(can_change(config, config.slave[0], terminal()), 0, 154, 166)
    assert not can_change(config, config.slave[0], terminal(154, 166))
    assert not misfits(config, made_bus(terminal()), load_profiles(), [0])
