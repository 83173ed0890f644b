"""Mailboxes and CoE of many slaves at once: uploads, lost frames, and slaves that answer oddly."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from wire_bench import FIRST_STATION, Correspondent, corresponding, in_preop

from conftest import names, naming
from ecatd.base.errors import EcatError, NoAnswerError, SdoAbortError, StateError
from ecatd.etg import unit_codes
from ecatd.etg.datatypes import DataType
from ecatd.etg.dictionary import DictionaryEntry, DictionaryObject
from ecatd.master.frames.datagrams import Datagrams, fpwr
from ecatd.master.mailbox import coe as coe_module
from ecatd.master.mailbox import mailbox as mailbox_module
from ecatd.master.mailbox import mailbox_queue as queue_module
from ecatd.master.mailbox.coe import Coe, UnsizedBytes
from ecatd.master.mailbox.conversation import Conversation, converse
from ecatd.master.mailbox.dictionary import read_dictionary, read_object
from ecatd.master.mailbox.mailbox_queue import MailboxQueue
from ecatd.master.mailbox.sdo_information import (
    EntryDescription,
    ObjectDescription,
    describe_entry,
    describe_object,
    list_objects,
)
from ecatsim.slave import sii
from ecatsim.slave.device import Device
from ecatsim.slave.mailbox import MailboxFault
from ecatsim.slave.objects import Access
from ecatsim.slave.sdo_information import InformationServer

LONG = bytes(range(256)) * 3
LONGEST = 1500
NO_OBJECT = 0x06020000
COE, EMERGENCY, REQUEST, RESPONSE, INFORMATION = 3, 1, 2, 3, 8


class Archive(Device):
    """Objects of all sizes."""

    vendor, product, revision, order = 0xFFFF, 1, 1, "Archive"
    mailbox = sii.Mailbox(receive_size=48, send=0x1030, send_size=48, coe_details=0x2F)

    def describe(self) -> None:
        add = self.dictionary.variable
        add(0x2000, "Small", DataType.INTEGER16, -2, Access.RW)
        add(0x2001, "Text", DataType.VISIBLE_STRING, "hello world")
        add(0x2002, "A long name that does not fit into one mail", DataType.OCTET_STRING, LONG)
        add(0x2003, "Secret", DataType.UNSIGNED8, 1, Access.WO)
        add(0x2004, "Notes", DataType.OCTET_STRING, bytes(LONGEST), Access.RW)
        self.dictionary.array(0x2010, "Row", DataType.UNSIGNED16, [1, 2, 3], Access.RW)


class Roomy(Archive):
    """The same in larger mails."""

    mailbox = sii.Mailbox(receive_size=512, send=0x1200, send_size=512, coe_details=0x2F)


def conversation(coe: Coe, *uploads: tuple[int, int]) -> Conversation[list[bytes | int]]:
    """Uploads, and the abort codes of those that are refused."""

    def part() -> Conversation[list[bytes | int]]:
        found: list[bytes | int] = []
        for index, subindex in uploads:
            try:
                found.append((yield from coe.upload(index, subindex)))
            except SdoAbortError as abort:
                found.append(abort.code)
        return found

    return (yield from coe.converse(part))


def slaves(count: int) -> list[Coe]:
    return [Coe(position, FIRST_STATION + position, MailboxQueue()) for position in range(count)]


def ask(
    registers: Datagrams, count: int, *uploads: tuple[int, int]
) -> tuple[list[Coe], list[list[bytes | int]]]:
    coe = slaves(count)
    return coe, converse(registers, [conversation(item, *uploads) for item in coe])


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Slaves that do not answer are given up sooner."""
    monkeypatch.setattr(queue_module, "_ANSWER_S", 0.2)
    monkeypatch.setattr(mailbox_module, "_REPEAT_S", 0.1)
    monkeypatch.setattr(coe_module, "_DOWNLOAD_S", 0.2)
    monkeypatch.setattr(coe_module, "_SYNCHRONIZE_S", 0.4)


# --- slaves that answer as they should -------------------------------------------------------


UPLOADS = [(0x2000, 0), (0x2001, 0), (0x2002, 0), (0x2010, 3), (0x2003, 0), (0x3000, 0)]
CONTENTS = [b"\xfe\xff", b"hello world", LONG, b"\x03\0", 0x06010001, NO_OBJECT]


def test_objects_of_all_sizes_are_read_from_all_slaves() -> None:
    with in_preop(Archive(), Roomy(), Archive()) as (registers, _wire):
        coe, found = ask(registers, 3, *UPLOADS)
        assert found == [CONTENTS] * 3
        assert [item.mailbox.skipped for item in coe] == [0, 0, 0]


class Vague(Archive):
    """Its answers do not say how many of their four bytes are meant; the others are not 0."""

    sized_uploads = False


def test_an_answer_without_a_size_has_that_of_its_type() -> None:
    def part(coe: Coe) -> Conversation[list[bytes]]:
        yield from coe.open()
        found = []
        for index, size in ((0x2000, 2), (0x2010, 1), (0x2001, 1), (0x2000, 0), (0x2000, 8)):
            found.append((yield from coe.upload(index, 0, size=size)))
        return found

    with in_preop(Vague(), Archive()) as (registers, _wire):
        vague, plain = converse(registers, [part(coe) for coe in slaves(2)])
    four = b"\xfe\xff\xa5\xa5"
    assert vague == [b"\xfe\xff", b"\x03", b"hello world", four, four]
    assert [isinstance(data, UnsizedBytes) for data in vague] == [False, False, False, True, False]
    assert plain == [b"\xfe\xff", b"\x03", b"hello world", b"\xfe\xff", b"\xfe\xff"]


def test_whole_objects_and_descriptions() -> None:
    def whole(coe: Coe) -> Conversation[tuple[object, ...]]:
        yield from coe.open()
        row = yield from coe.upload(0x2010, 0, complete=True)
        names = []
        for index in (0x2000, 0x2002, 0x2010):
            names.append((yield from describe_object(coe, index)))
        entry = yield from describe_entry(coe, 0x2010, 2)
        with pytest.raises(SdoAbortError) as refused:
            yield from describe_object(coe, 0x3000)
        return row, names, entry, refused.value.code

    with in_preop(Archive(), Roomy()) as (registers, _wire):
        for row, names, entry, code in converse(registers, [whole(c) for c in slaves(2)]):
            assert row == bytes.fromhex("0300 0100 0200 0300")
            assert names == [
                ObjectDescription("Small", DataType.INTEGER16, 0, 7),
                ObjectDescription(
                    "A long name that does not fit into one mail", DataType.OCTET_STRING, 0, 7
                ),
                ObjectDescription("Row", DataType.UNSIGNED16, 3, 8),
            ]
            assert entry == EntryDescription("SubIndex 002", DataType.UNSIGNED16, 16, Access.RW)
            assert code == NO_OBJECT


@pytest.mark.parametrize("size", [*range(1, 13), 31, 32, 33, 39, 40, 41, 46, 47, 700, LONGEST])
def test_downloads_of_all_sizes(size: int) -> None:
    """Expedited, normal, and in segments of every length."""
    sent = bytes(n * 7 % 251 + 1 for n in range(size))

    def write(coe: Coe) -> Conversation[bytes]:
        yield from coe.open()
        yield from coe.download(0x2004, 0, sent)
        return (yield from coe.upload(0x2004, 0))

    with in_preop(Archive(), Roomy()) as (registers, _wire):
        for written in converse(registers, [write(coe) for coe in slaves(2)]):
            assert written.rstrip(b"\0") == sent


def test_whole_objects_are_written() -> None:
    row = bytes.fromhex("0300 0a00 0b00 0c00")

    def write(coe: Coe) -> Conversation[bytes]:
        yield from coe.open()
        yield from coe.download(0x2010, 0, row, complete=True)
        return (yield from coe.upload(0x2010, 0, complete=True))

    with in_preop(Archive(), Roomy()) as (registers, _wire):
        assert converse(registers, [write(coe) for coe in slaves(2)]) == [row] * 2


def test_downloads_that_are_refused() -> None:
    def write(coe: Coe) -> Conversation[list[str]]:
        yield from coe.open()
        found = []
        for index, data in ((0x2000, b"1234"), (0x2000, bytes(90)), (0x3000, b"1")):
            with pytest.raises(SdoAbortError) as refused:
                yield from coe.download(index, 0, data)
            found.append(str(refused.value))
        return found

    with in_preop(Archive()) as (registers, _wire):
        (found,) = converse(registers, [write(coe) for coe in slaves(1)])
    assert [text[:18] for text in found] == ["slave 0, 0x2000:00"] * 2 + ["slave 0, 0x3000:00"]
    assert "0x06070012" in found[0]
    assert "0x06020000" in found[2]


def test_the_whole_dictionary() -> None:
    def read(coe: Coe) -> Conversation[list[DictionaryObject]]:
        yield from coe.open()
        return (yield from read_dictionary(coe))

    devices = [Archive(), Roomy()]
    with in_preop(*devices) as (registers, _wire):
        small, large = converse(registers, [read(coe) for coe in slaves(2)])
    assert small == large
    found = {item.index: item for item in small}
    assert list(found) == sorted(found)
    assert {0x1000, 0x1018, 0x2000, 0x2001, 0x2002, 0x2003, 0x2004, 0x2010} <= found.keys()
    name = "A long name that does not fit into one mail"
    assert found[0x2002] == DictionaryObject(
        0x2002,
        name,
        7,
        DataType.OCTET_STRING,
        {0: DictionaryEntry(name, DataType.OCTET_STRING, 8 * len(LONG), Access.RO, default=LONG)},
    )
    row = found[0x2010]
    assert (row.name, row.code, list(row.entries)) == ("Row", 8, [0, 1, 2, 3])
    assert row.entries[3] == DictionaryEntry(
        "SubIndex 003", DataType.UNSIGNED16, 16, Access.RW, default=b"\3\0"
    )


def test_unit_default_and_limits_are_read_from_slaves_that_give_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The second slave has nothing but names, and refuses to be asked for the rest."""

    class Precise(Archive):
        def describe(self) -> None:
            super().describe()
            limit = self.dictionary.variable(0x2020, "Limit", DataType.INTEGER16, 7, Access.RW)
            limit.minimum, limit.maximum, limit.default = -5, 9, 3
            limit.unit = unit_codes.code("mV")

    class Terse(Precise):
        pass

    describe = InformationServer._entry_description

    def refuse(self: InformationServer, index: int, subindex: int, wanted: int) -> bytes:
        if wanted & ~0x07 and self._dictionary is devices[1].dictionary:
            raise SdoAbortError(0x06010000)
        return describe(self, index, subindex, wanted)

    def read(coe: Coe) -> Conversation[DictionaryObject]:
        yield from coe.open()
        return (yield from read_object(coe, 0x2020))

    devices = [Precise(), Terse()]
    monkeypatch.setattr(InformationServer, "_entry_description", refuse)
    with in_preop(*devices) as (registers, _wire):
        precise, terse = converse(registers, [read(coe) for coe in slaves(2)])
    plain = DictionaryEntry("Limit", DataType.INTEGER16, 16, Access.RW)
    values: dict[str, Any] = {"default": b"\3\0", "minimum": b"\xfb\xff", "maximum": b"\x09\0"}
    assert precise.entries == {0: replace(plain, unit=0xFD260000, **values)}
    assert terse.entries == {0: plain}
    assert DictionaryObject.from_map(precise.to_map()) == precise


def test_r13_emergencies_in_between_are_put_aside() -> None:
    devices = [Archive(), Archive()]

    def with_emergencies(coe: Coe) -> Conversation[list[bytes]]:
        yield from coe.open()
        found = []
        for code in (0x1000, 0x8130):
            devices[1].emergency(code, 0x11)
            found.append((yield from coe.upload(0x2002, 0)))
        return found

    with in_preop(*devices) as (registers, _wire):
        coe = slaves(2)
        found = converse(registers, [with_emergencies(item) for item in coe])
        assert found == [[LONG] * 2] * 2
        assert not coe[0].emergencies
        assert {code for code, register in coe[1].emergencies} == {0x1000, 0x8130}
        assert coe[1].mailbox.skipped == len(coe[1].emergencies) == 4


def test_a_slow_slave_is_waited_for() -> None:
    slow = Archive()
    with in_preop(Archive(), slow) as (registers, _wire):
        slow.mailbox_fault = MailboxFault("slow", 0.3)
        assert ask(registers, 2, *UPLOADS[:2])[1] == [CONTENTS[:2]] * 2


# --- mailbox protocol ------------------------------------------------------------------------


def mail(service: int, body: bytes, *, kind: int = COE, counter: int = 1) -> bytes:
    content = struct.pack("<H", service << 12) + body
    return struct.pack("<HHBB", len(content), 0, 0, kind | counter << 4) + content


def expedited(request: bytes, data: bytes = b"\x05") -> bytes:
    """The answer to an upload."""
    head = bytes([0x43 | (4 - len(data)) << 2]) + request[9:12]
    return mail(RESPONSE, head + data.ljust(4, b"\0"))


def test_answers_to_a_request_that_was_given_up_are_not_taken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The first answer comes only when the master has asked again, and is not the newest value."""
    monkeypatch.setattr(queue_module, "_ANSWER_S", 0.05)
    monkeypatch.setattr(coe_module, "_SYNCHRONIZE_S", 60.0)
    late: list[bytes] = []

    def answers(request: bytes) -> list[bytes]:
        if len(slave.mails) == 1:
            late.append(expedited(request, b"\x01"))
            return []
        return [*(late.pop() for _ in late[:]), expedited(request)]

    slave = Correspondent(answers)
    with corresponding(slave) as (registers, _wire):
        (coe,), (found,) = ask(registers, 1, *UPLOADS[:2])
    assert found == [b"\x05"] * 2
    assert coe.mailbox.skipped > 0


def test_messages_are_counted_from_1_to_7() -> None:
    slave = Correspondent(lambda request: [expedited(request)])
    with corresponding(slave) as (registers, _wire):
        assert ask(registers, 1, *[(0x2000, n) for n in range(15)])[1] == [[b"\x05"] * 15]
    assert [item[5] >> 4 for item in slave.mails] == [1, 2, 3, 4, 5, 6, 7] * 2 + [1]
    assert {len(item) for item in slave.mails} == {128}


def patient() -> MailboxQueue:
    """A busy machine may keep this process waiting for longer than a slave may take."""
    queue = MailboxQueue()
    queue.answer_s = 30.0
    return queue


@pytest.mark.parametrize("unseen", [False, True])
def test_any_frame_may_get_lost(unseen: bool) -> None:
    """Whichever frame it is: no answer is missed, none is taken twice, none asked for anew."""
    uploads = [(0x2000, 0), (0x2002, 0), (0x2001, 0)]
    device = Roomy()
    with in_preop(device) as (registers, wire):
        answered: list[bytes] = []
        server = device._services.server
        handler = server.handlers[COE]
        server.handlers[COE] = lambda body: answered.append(body) or handler(body)
        # Looks come as often as they do, so it is other accesses that are counted.
        lose, seen = [0], [0]

        def is_next(number: int) -> bool:
            register = int.from_bytes(wire.frames[number][20:22], "little")
            seen[0] += register >= 0x1000
            return register >= 0x1000 and seen[0] == lose[0]

        wire.lose, wire.unseen = is_next, unseen
        queue = patient()
        (plain,) = converse(registers, [conversation(Coe(0, FIRST_STATION, queue), *uploads)])
        requests, accesses = answered[:], seen[0]
        assert plain == [b"\xfe\xff", LONG, b"hello world"]
        assert accesses == 2 * len(requests) == 8
        for lost in range(1, accesses + 1):
            answered.clear()
            lose[0], seen[0] = lost, 0
            # The slave remembers the number of the last message.
            coe = Coe(0, FIRST_STATION, queue)
            assert converse(registers, [conversation(coe, *uploads)]) == [plain]
            assert answered == requests, f"access {lost}"


@pytest.mark.parametrize("slow", [False, True])
@pytest.mark.parametrize("unseen", [False, True])
@pytest.mark.parametrize("alone", [False, True])
def test_a_lost_frame_brings_no_value_of_an_earlier_conversation(
    alone: bool, unseen: bool, slow: bool
) -> None:
    """Wherever it gets lost: a mailbox that is asked to repeat may have nothing new to say yet."""
    device = Archive()
    with in_preop(device) as (registers, wire):
        queue, wire.unseen = patient(), unseen
        if slow:
            device.mailbox_fault = MailboxFault("slow", 0.03)
        for lost in range(14):
            device[0x2000, 0] = lost
            begin = len(wire.frames)
            wire.lose = lambda number, lost=begin + lost: number == lost  # type: ignore[misc]
            coe = Coe(0, FIRST_STATION, queue, alone=alone)
            assert converse(registers, [conversation(coe, (0x2000, 0))]) == [
                [struct.pack("<H", lost)]
            ]


@pytest.mark.parametrize("unseen", [False, True])
def test_an_answer_that_got_lost_is_asked_for_though_another_message_follows(
    unseen: bool, short: None
) -> None:
    device = Archive()
    with in_preop(device) as (registers, wire):
        server = device._services.server
        handler, requests = server.handlers[COE], []

        def followed(body: bytes) -> list[bytes]:
            requests.append(body)
            device.emergency(0x1000, 0x11)
            return handler(body)

        server.handlers[COE] = followed
        queue, wire.unseen = MailboxQueue(), unseen
        for lost in range(14):
            requests.clear()
            begin = len(wire.frames)
            wire.lose = lambda number, lost=begin + lost: number == lost  # type: ignore[misc]
            coe = Coe(0, FIRST_STATION, queue, alone=True)
            data = struct.pack("<H", lost)
            converse(registers, [coe.converse(lambda: coe.download(0x2000, 0, data))])  # noqa: B023
            assert device[0x2000, 0] == lost
            assert sum(body[2:3] < b"\x40" for body in requests) == 1, "it was written once"


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_many_frames_get_lost(seed: int) -> None:
    with in_preop(*[Archive() for _ in range(12)]) as (registers, wire):
        wire.lose = lambda number: number * 7919 % 101 % 8 == seed
        wire.unseen = seed % 2 == 0
        assert ask(registers, 12, *UPLOADS)[1] == [CONTENTS] * 12


def test_a_request_for_repetition_that_gets_lost_is_made_again() -> None:
    slave = Correspondent(lambda request: [expedited(request)])
    with corresponding(slave) as (registers, wire):
        lost: list[int] = []

        def lose(number: int) -> bool:
            register = int.from_bytes(wire.frames[number][20:22], "little")
            if register in (0x1080, 0x080E) and lost.count(register) < 2:
                lost.append(register)
                return True
            return False

        wire.lose, wire.unseen = lose, True
        assert ask(registers, 1, (0x2000, 0), (0x2000, 1))[1] == [[b"\x05"] * 2]
        assert sorted(lost) == [0x080E] * 2 + [0x1080] * 2
        assert len(slave.mails) == 2


def test_a_second_copy_of_a_message_is_not_taken_for_the_next_one() -> None:
    """The slave has taken and answered the first copy, but not yet read the second one."""
    slave = Correspondent(lambda request: [expedited(request)])
    slave.pause[1] = 0.1
    with corresponding(slave) as (registers, wire):
        lost: list[int] = []

        def lose(number: int) -> bool:
            is_write = wire.frames[number][20:22] == b"\x00\x10"
            if is_write:
                lost.append(number)
            return is_write and len(lost) == 1

        wire.lose = lose
        (coe,), found = ask(registers, 1, (0x2000, 0), (0x2000, 1))
    assert found == [[b"\x05"] * 2]
    # On a busy machine more copies may be sent, as an answer comes late.
    came = [(item[5] >> 4, item[11]) for item in slave.mails]
    assert came[:2] == [(1, 0), (1, 0)]
    assert sorted(set(came)) == [(1, 0), (2, 1)]
    assert coe.mailbox.skipped >= 1, "the answer to the copy"


def test_a_slave_that_cannot_repeat_is_asked_anew(short: None) -> None:
    slave = Correspondent(lambda request: [expedited(request)], repeats=False)
    with corresponding(slave) as (registers, wire):
        lost: list[int] = []

        def lose(number: int) -> bool:
            is_read = wire.frames[number][20:22] == b"\x80\x10"
            if is_read:
                lost.append(number)
            return is_read and len(lost) == 1

        wire.lose = lose
        assert ask(registers, 1, (0x2000, 0))[1] == [[b"\x05"]]
        asked = [struct.unpack_from("<HB", item, 9) for item in slave.mails]
        assert asked == [(0x2000, 0), (0x1018, 0x80), (0x2000, 0)], "nothing late passes for it"


# --- slaves that do not answer as they should --------------------------------------------------

SILENT = ("slave 0", "answer", "mailbox")
SILENCE = " | ".join(SILENT)


def test_a_slave_that_does_not_answer_is_named_and_holds_nobody_up(short: None) -> None:
    devices = [Archive(), Archive(), Archive(), Archive()]
    with in_preop(*devices) as (registers, _wire):
        finished: list[int] = []

        def until_the_end(number: int, coe: Coe) -> Conversation[None]:
            yield from conversation(coe, *UPLOADS)
            finished.append(number)

        devices[1].mailbox_fault = MailboxFault("stuck")
        with pytest.raises(NoAnswerError, match=naming("slave 1", "0x2000:00", "mailbox")):
            converse(registers, [until_the_end(n, coe) for n, coe in enumerate(slaves(4))])
        assert sorted(finished) == [0, 2, 3]
        devices[2].mailbox_fault = MailboxFault("full")
        with pytest.raises(StateError) as error:
            ask(registers, 4, (0x2000, 0))
        first, second = str(error.value).split("; ")
        names(first, "slave 1", "0x2000:00", "mailbox")
        names(second, "slave 2", "0x2000:00", "mailbox", "take")


def test_only_the_first_of_many_silent_slaves_are_named(short: None) -> None:
    with (
        corresponding(*[Correspondent(lambda _request: []) for _ in range(9)]) as (registers, _),
        pytest.raises(StateError, match=r"slave 4, 0x2000:00: [^;]*; [^;]*\b4 slaves\b[^;]*$"),
    ):
        ask(registers, 9, (0x2000, 0))


def test_a_slave_that_is_gone(short: None) -> None:
    with in_preop(Archive()) as (registers, wire):

        def lost_after(coe: Coe) -> Conversation[None]:
            yield from coe.open()
            wire.lose = lambda _number: True
            yield from coe.upload(0x2000, 0)

        with pytest.raises(NoAnswerError, match=naming("0x2000:00", *SILENT)):
            converse(registers, [lost_after(*slaves(1))])
        with pytest.raises(NoAnswerError, match=naming("CoE", *SILENT)):
            ask(registers, 1)


def test_a_mailbox_that_is_not_set_up() -> None:
    with in_preop(Archive()) as (registers, _wire):
        registers.exchange([fpwr(FIRST_STATION, 0x080E, b"\0")])
        with pytest.raises(StateError, match=naming("slave 0", "CoE", "sync manager 1")):
            ask(registers, 1)
    slave = Correspondent(lambda _request: [])
    with (
        corresponding(slave, size=15) as (registers, _wire),
        pytest.raises(StateError, match=naming("sync manager 0", "15 bytes", 16, 1486)),
    ):
        ask(registers, 1)


def test_starting_can_be_cancelled() -> None:
    slave = Correspondent(lambda _request: [])
    with (
        corresponding(slave) as (registers, _wire),
        pytest.raises(StateError, match=naming("stopped")),
    ):
        converse(registers, [conversation(*slaves(1), (0x2000, 0))], lambda: bool(slave.mails))


def segments(*parts: bytes) -> Callable[[bytes], list[bytes]]:
    """Answers the first upload by a segmented one of 20 bytes, and then with these segments."""
    left: list[bytes] = []

    def answers(request: bytes) -> list[bytes]:
        if request[8] & 0xE0 == 0x40:
            left[:] = parts
            return [mail(RESPONSE, b"\x41" + request[9:12] + struct.pack("<I", 20))]
        return [mail(RESPONSE, left.pop(0))]

    return answers


def always(*mails: bytes) -> Callable[[bytes], list[bytes]]:
    return lambda _request: list(mails)


ADDRESS = b"\x00\x20\x00"
WRONG = {
    "no body": (always(b"\0\0\0\0\0\x13"), "0 bytes | CoE"),
    "longer than the mailbox": (always(b"\xff\xff\0\0\0\x13"), "65535 bytes"),
    "short SDO": (always(mail(RESPONSE, b"\x43" + ADDRESS)), "4 bytes | SDO"),
    "mailbox error": (
        always(struct.pack("<HHBBHH", 4, 0, 0, 0x10, 1, 4)),
        "mailbox error | 0x0004",
    ),
    "short mailbox error": (always(b"\x01\0\0\0\0\x10\x01"), "error | 1 bytes"),
    "too much": (
        always(mail(RESPONSE, b"\x41" + ADDRESS + b"\xff" * 4)),
        "4294967295 bytes | 65536",
    ),
    "less than announced": (
        segments(b"\x00" + bytes(7), b"\x1f" + bytes(7)),
        "20 bytes | 7",
    ),
    "wrong toggle": (segments(b"\x10" + bytes(7)), "segment | missing"),
    "another object": (always(mail(RESPONSE, b"\x43\0\x30\0\0\0\0\0")), SILENCE),
    "another protocol": (always(mail(2, bytes(8), kind=2)), SILENCE),
    "another service": (always(mail(5, bytes(8))), SILENCE),
    "an emergency": (always(mail(EMERGENCY, bytes(8))), SILENCE),
    "a segment": (always(mail(RESPONSE, bytes(8))), SILENCE),
    "a description": (always(mail(INFORMATION, bytes(8))), SILENCE),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_answers_to_uploads(case: str, short: None) -> None:
    answers, text = WRONG[case]
    with corresponding(Correspondent(answers)) as (registers, _wire):
        with pytest.raises(EcatError) as error:
            ask(registers, 1, (0x2000, 0))
        assert isinstance(error.value, NoAnswerError | StateError)
        assert str(error.value).startswith("slave 0, 0x2000:00: ")
        names(error.value, *text.split(" | "))


def test_segments_without_data_end_some_time(short: None) -> None:
    """They are no error by themselves, but a slave may send them for ever."""
    toggle = [0x10]

    def answers(request: bytes) -> list[bytes]:
        if request[8] & 0xE0 == 0x40:
            toggle[0] = 0x10
            return [mail(RESPONSE, b"\x41" + request[9:12] + struct.pack("<I", 20))]
        toggle[0] ^= 0x10
        return [mail(RESPONSE, bytes([toggle[0] | 0x0E]) + bytes(7))]

    with (
        corresponding(Correspondent(answers)) as (registers, _wire),
        pytest.raises(StateError, match=naming("slave 0", "0x2000:00", "segment", "without data")),
    ):
        ask(registers, 1, (0x2000, 0))


def byte_by_byte(index: int) -> Correspondent:
    """A slave that sends a byte in each segment of this object, and others as they are."""
    toggle = [0x10]

    def answers(request: bytes) -> list[bytes]:
        if request[9:11] == index.to_bytes(2, "little") and request[8] & 0xE0 == 0x40:
            toggle[0] = 0x10
            return [mail(RESPONSE, b"\x41" + request[9:12] + struct.pack("<I", 60_000))]
        if request[8] & 0xE0 == 0x40:
            return [mail(RESPONSE, b"\x4f" + request[9:12] + b"x\0\0\0")]
        toggle[0] ^= 0x10
        return [mail(RESPONSE, bytes([toggle[0] | 0x0C]) + bytes(7))]

    return Correspondent(answers)


def test_an_object_that_comes_byte_by_byte_is_given_up(
    short: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each answer is prompt, so only the whole takes too long."""
    monkeypatch.setattr(queue_module, "_WHOLE", 2)
    with corresponding(byte_by_byte(0x2000)) as (registers, _wire):
        for _ in range(2):  # the second conversation begins anew
            with pytest.raises(NoAnswerError, match=naming("0x2000:00", "0.4 s", "without end")):
                ask(registers, 1, (0x2000, 0))
        assert ask(registers, 1, (0x2001, 0))[1] == [[b"x"]]


def test_a_flood_of_messages_is_not_waited_for(short: None) -> None:
    """A mailbox that is always full of something else."""
    slave = Correspondent(lambda _request: [mail(EMERGENCY, bytes(8))] * 100_000)
    with (
        corresponding(slave) as (registers, _wire),
        pytest.raises(NoAnswerError, match=naming("0x2000:00", *SILENT, "other messages")),
    ):
        ask(registers, 1, (0x2000, 0))


DESCRIPTIONS = {
    "short": (always(mail(INFORMATION, b"\x04")), "1 bytes | SDO information"),
    "cut off": (always(mail(INFORMATION, b"\x04\0\0\0\x00\x20")), "description | 2 bytes"),
    "without end": (
        lambda _request: [mail(INFORMATION, b"\x84\0\x01\0\x00\x20" + bytes(100))] * 1000,
        "65536 bytes",
    ),
    "without end or data": (
        always(
            mail(INFORMATION, b"\x84\0\x01\0\x00\x20"),
            *[mail(INFORMATION, b"\x84\0\x01\0")] * 20_000,
        ),
        "fragment without data",
    ),
    "of another object": (always(mail(INFORMATION, b"\x04\0\0\0\x01\x20" + bytes(9))), SILENCE),
    "with a part missing": (
        always(mail(INFORMATION, b"\x84\0\x01\0\x00\x20" + bytes(9))),
        SILENCE,
    ),
}


@pytest.mark.parametrize("case", DESCRIPTIONS)
def test_wrong_descriptions(case: str, short: None) -> None:
    answers, text = DESCRIPTIONS[case]

    def describe(coe: Coe) -> Conversation[ObjectDescription]:
        yield from coe.open()
        return (yield from describe_object(coe, 0x2000))

    with (
        corresponding(Correspondent(answers)) as (registers, _wire),
        pytest.raises((NoAnswerError, StateError), match=naming(*text.split(" | "))),
    ):
        converse(registers, [describe(*slaves(1))])


def toggled(toggle: int) -> Callable[[bytes], list[bytes]]:
    """Answers a download, and each of its segments with this toggle bit."""

    def answers(request: bytes) -> list[bytes]:
        if request[8] & 0xE0 == 0x20:
            return [mail(RESPONSE, b"\x60" + request[9:12] + bytes(4))]
        return [mail(RESPONSE, bytes([0x20 | toggle]) + bytes(7))]

    return answers


WRONG_DOWNLOADS = {
    "silence": (always(), SILENCE),
    "another object": (always(mail(RESPONSE, b"\x60\0\x30\0" + bytes(4))), SILENCE),
    "another subindex": (always(mail(RESPONSE, b"\x60\0\x20\1" + bytes(4))), SILENCE),
    "an upload": (always(mail(RESPONSE, b"\x43" + ADDRESS + bytes(4))), SILENCE),
    "an abort of another one": (always(mail(REQUEST, b"\x80\0\x20\1" + bytes(4))), SILENCE),
    "short": (always(mail(RESPONSE, b"\x60" + ADDRESS)), "4 bytes | SDO"),
    "wrong toggle": (toggled(0), "segment | missing"),
}


@pytest.mark.parametrize("case", WRONG_DOWNLOADS)
def test_wrong_answers_to_downloads(case: str, short: None) -> None:
    """They are told, and the object is not written a second time."""
    answers, text = WRONG_DOWNLOADS[case]
    slave = Correspondent(answers)

    def write(coe: Coe) -> Conversation[None]:
        yield from coe.open()
        yield from coe.download(0x2000, 0, bytes(400))

    with (
        corresponding(slave) as (registers, _wire),
        pytest.raises((NoAnswerError, StateError), match=naming(*text.split(" | "))) as error,
    ):
        converse(registers, [write(*slaves(1))])
    assert str(error.value).startswith("slave 0, 0x2000:00: ")
    assert sum(item[8] & 0xE0 == 0x20 for item in slave.mails) == 1


# --- anything ----------------------------------------------------------------------------------

SDO = st.binary(min_size=0, max_size=24)
MAILS = st.one_of(
    st.binary(min_size=1, max_size=64),
    st.builds(
        mail,
        st.sampled_from([EMERGENCY, REQUEST, RESPONSE, INFORMATION]),
        st.one_of(
            SDO,
            st.builds(lambda a, b: bytes([a]) + ADDRESS + b, st.integers(0, 255), SDO),
            st.builds(
                lambda a, left, b: bytes([a, 0, left, 0]) + ADDRESS + b,
                st.sampled_from([0x04, 0x84, 0x06, 0x86, 0x07]),
                st.integers(0, 3),
                SDO,
            ),
        ),
        kind=st.sampled_from([COE, COE, COE, 0, 2]),
        counter=st.integers(0, 7),
    ),
)


@pytest.mark.long
@settings(max_examples=60)
@given(st.lists(st.lists(MAILS, max_size=3), min_size=1, max_size=12))
def test_whatever_a_slave_answers_it_is_a_result_or_an_error(script: list[list[bytes]]) -> None:
    answers = iter(script)
    slave = Correspondent(lambda _request: next(answers, []))

    def everything(coe: Coe) -> Conversation[list[object]]:
        yield from coe.open()
        found: list[object] = []
        for part in (
            coe.upload(0x2000, 0, tries=1),
            coe.upload(0x2000, 0, complete=True, tries=1),
            coe.download(0x2000, 0, bytes(300)),
            coe.download(0x2000, 0, b"12"),
            list_objects(coe),
            describe_object(coe, 0x2000),
            describe_entry(coe, 0x2000, 0),
        ):
            try:
                found.append((yield from part))
            except (SdoAbortError, NoAnswerError, StateError) as error:
                found.append(str(error))
        return found

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(queue_module, "_ANSWER_S", 0.02)
        patch.setattr(coe_module, "_DOWNLOAD_S", 0.02)
        patch.setattr(coe_module, "_SYNCHRONIZE_S", 0.02)
        with corresponding(slave) as (registers, _wire):
            (found,) = converse(registers, [everything(*slaves(1))])
    assert len(found) == 7
