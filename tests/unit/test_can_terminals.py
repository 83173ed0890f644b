"""Tables of CAN terminals: they fit together, and what is known of plants follows from them."""

from __future__ import annotations

from dataclasses import fields

import pytest

from ecatd.etg.can_terminals import (
    EL6751,
    KENDRION_LAYOUT,
    PROFILE_11,
    PROFILE_29,
    TERMINALS,
    Field,
    Layout,
    Messages,
    Mode,
    Settings,
    Status,
    frames_per_second,
    frames_through,
    queue_for,
    terminal_called,
    terminal_of,
)

LAYOUTS = {"11": PROFILE_11, "29": PROFILE_29, "kendrion": KENDRION_LAYOUT}


def _settings(**other: object) -> Settings:
    values: dict[str, object] = {
        "bit_rate": 500,
        "cycle_us": 8000,
        "identifiers": 29,
        "receive_queue": 10,
        "send_queue": 10,
        "flags": 8,
    }
    return Settings(**(values | other))  # type: ignore[arg-type]


def _fields(table: object) -> list[Field]:
    found = (getattr(table, item.name) for item in fields(table))  # type: ignore[arg-type]
    return [value for value in found if isinstance(value, Field)]


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_no_two_fields_share_bits(layout: Layout) -> None:
    """Fields of a block do not overlap, also those before the frames and those of the status."""
    status = _fields(layout.status)
    inputs = _fields(layout.inputs) + ([] if layout.status.size else status)
    blocks = [inputs, _fields(layout.outputs)]
    blocks += [status, _fields(layout.received), _fields(layout.sent)]
    for block in blocks:
        used = 0
        for item in block:
            bits = item.mask << 8 * item.at
            assert item.shift + item.bits <= 8 * item.size
            assert not used & bits, item
            used |= bits


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_what_stands_before_the_frames_ends_before_them(layout: Layout) -> None:
    """So the first frame begins where the fields before it end."""
    for head, messages in ((layout.inputs, layout.received), (layout.outputs, layout.sent)):
        assert max(item.at + item.size for item in _fields(head)) <= messages.first
        assert max(item.at + item.size for item in _fields(messages)) <= messages.data
        assert messages.data + 8 <= messages.stride


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
@pytest.mark.parametrize("part", ["received", "sent"])
def test_a_frame_comes_back_as_it_was_written(layout: Layout, part: str) -> None:
    """Every field takes its largest value, and leaves the others alone."""
    messages: Messages = getattr(layout, part)
    block = bytearray(messages.stride)
    wanted = {}
    for item in (messages.length, messages.identifier, messages.remote, messages.extended):
        if item is not None:
            wanted[item] = (1 << item.bits) - 1
            item.write(block, wanted[item])
    assert {item: item.read(block) for item in wanted} == wanted
    assert block[messages.data :] == bytes(messages.stride - messages.data)
    with pytest.raises(ValueError, match="does not fit into"):
        messages.remote.write(block, 2)


def test_the_plant_of_dlr() -> None:
    """Its sync managers of EL6751 have these lengths with ten frames each way."""
    assert PROFILE_29.output_bytes(10) == 166
    assert PROFILE_29.input_bytes(10) == 154
    assert PROFILE_29.status_at(10) == 148


def test_the_settings_of_the_plant_of_dlr() -> None:
    """The objects of its example follow from the settings, in its order."""
    written = EL6751.written(_settings(filters=((0, 0x1FFFFFFF),)))
    found = [(item.index, item.subindex, item.data.hex()) for item in written]
    assert found[:6] == [
        (0xF800, 0x00, "00"),
        (0xF800, 0x01, "7f"),
        (0xF800, 0x02, "02"),
        (0xF800, 0x03, "8000"),
        (0xF800, 0x04, "401f0000"),
        (0xF800, 0x06, "00"),
    ]
    assert found[11:] == [
        (0xF800, 0x00, "11"),
        (0x8000, 0x00, "00"),
        (0x8000, 0x01, "0000"),
        (0x8000, 0x20, "0800"),
        (0x8000, 0x21, "0a"),
        (0x8000, 0x22, "0a"),
        (0x8000, 0x23, "9600"),
        (0x8000, 0x24, "9600"),
        (0x8000, 0x00, "24"),
        (0x8001, 0x00, "010000000000ffffff1f"),
    ]
    assert written[-1].complete
    assert not any(item.complete for item in written[:-1])


def test_a_terminal_without_filters_gets_none() -> None:
    """What was not asked for is not written."""
    assert all(item.index != 0x8001 for item in EL6751.written(_settings()))


def test_a_frame_of_the_gateway_of_esd() -> None:
    """The bytes that broccoli writes and reads for identifier 0x123 with three bytes."""
    sent = bytearray(PROFILE_11.sent.stride)
    transaction = PROFILE_11.sent.transaction
    assert transaction is not None
    transaction.write(sent, 0x0102)
    PROFILE_11.sent.length.write(sent, 3)
    PROFILE_11.sent.identifier.write(sent, 0x123)
    assert sent[:4] == bytes.fromhex("02 01 63 24")
    received = bytes.fromhex("73 24 01 02 03 00 00 00 00 00")
    assert PROFILE_11.received.length.read(received) == 3
    assert PROFILE_11.received.remote.read(received) == 1
    assert PROFILE_11.received.identifier.read(received) == 0x123


def test_the_process_data_of_kendrion() -> None:
    """Nine frames and the state fill what its manual says is the most."""
    assert KENDRION_LAYOUT.input_bytes(9) == 160
    assert KENDRION_LAYOUT.status_at(9) == 0


def test_terminals_are_found() -> None:
    """By identity where it is known, and always by the key of the configuration."""
    assert terminal_of(0x2, 0x1A5F3052) is EL6751
    assert terminal_of(0x2, 0x07D43052) is None
    assert terminal_called("nothing") is None
    for terminal in TERMINALS:
        assert terminal_called(terminal.key) is terminal
        assert terminal.source


def test_every_table_says_where_it_comes_from() -> None:
    """Since nothing of it was tried on hardware."""
    for layout in LAYOUTS.values():
        parts = (layout.received, layout.sent, layout.inputs, layout.outputs, layout.status)
        assert all(part.source for part in parts)
    assert all(item.source for terminal in TERMINALS for item in terminal.objects)


def test_queues() -> None:
    """Deep enough for the cycles in which a terminal answers."""
    assert queue_for(2000, 1000) == 10
    assert queue_for(2001, 1000) == 11
    assert queue_for(1, 1000) == 1
    full = frames_per_second(500)
    assert round(full) == 10638
    assert queue_for(full, 1000) == 54
    assert queue_for(full, 1000, Mode.FAST) == 11
    assert queue_for(frames_per_second(1000, 29, 8), 1000) == 39
    assert frames_through(32, 1000) == 6400
    assert frames_through(queue_for(full, 1000), 1000) >= full


def test_status_fields_are_optional() -> None:
    """A terminal that says nothing has none."""
    assert not _fields(Status(0, "none"))
