"""Mailbox: counters, repeats, error replies, and faults."""

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from slave_bench import COE, FOE, INIT, PREOP, SAFEOP, Bench

from conftest import naming
from ecatd.base.errors import UsageError
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo
from ecatsim import Device, Mailbox
from ecatsim.slave.mailbox import MailboxError, MailboxFault, MailboxMode, MailboxServer, Protocol

REPEAT = 0x02
UPLOAD = struct.pack("<HBHBI", 2 << 12, 0x40, 0x1000, 0, 0)


class Sample(Device):
    order = "Sample"
    mailbox = Mailbox()


class Wire:
    """The master's side of a mailbox server: one mail at a time."""

    def __init__(self):
        self.mail = None
        self.server = MailboxServer({Protocol.COE: lambda body: [body] * body[0]}, self.put)

    def put(self, mail, again):
        if self.mail is not None and not again:
            return False
        self.mail = mail
        return True

    def read(self):
        mail, self.mail = self.mail, None
        self.server.was_read()
        return mail

    def write(self, body, kind=3, counter=1, length=None):
        size = len(body) if length is None else length
        self.server.receive(struct.pack("<HHBB", size, 0, 0, kind | counter << 4) + body)


def test_replies_wait_for_each_other_and_are_counted():
    wire = Wire()
    wire.write(b"\x03x")
    kinds = [wire.read()[5] for _ in range(3)]
    assert kinds == [0x13, 0x23, 0x33]
    assert wire.read() is None


@pytest.mark.parametrize("counter", [0, 3])
def test_a_counter_that_does_not_count(counter):
    wire = Wire()
    wire.server.fixed_counter = counter
    wire.write(b"\x03x")
    assert [wire.read()[5] >> 4 for _ in range(3)] == [counter] * 3


def test_counter_wraps_from_7_to_1():
    wire = Wire()
    wire.write(b"\x09")
    assert [wire.read()[5] >> 4 for _ in range(9)] == [1, 2, 3, 4, 5, 6, 7, 1, 2]


def test_repeated_request_is_answered_once():
    wire = Wire()
    for counter in (1, 1, 2, 2, 0, 0):
        wire.write(b"\x01", counter=counter)
    assert [wire.read() is not None for _ in range(5)] == [True] * 4 + [False]


def test_lost_mail_is_given_again():
    wire = Wire()
    wire.write(b"\x03x")
    first = wire.read()  # lost on the way to the master; the second is offered already
    wire.server.again()
    assert wire.read() == first
    assert [wire.read()[5] for _ in range(2)] == [0x23, 0x33]


def test_repeat_request_without_a_mail_does_no_harm():
    wire = Wire()
    wire.server.again()
    assert wire.mail is None
    wire.write(b"\x01")
    wire.server.again()
    assert wire.read()[5] == 0x13


@pytest.mark.parametrize(
    ("kind", "body", "length", "detail"),
    [
        (FOE, b"\x01", None, MailboxError.UNSUPPORTED_PROTOCOL),
        (9, b"\x01", None, MailboxError.UNSUPPORTED_PROTOCOL),
        (COE, b"\x01", 400, MailboxError.INVALID_SIZE),
        (COE, b"", None, MailboxError.SIZE_TOO_SHORT),
        (COE, struct.pack("<H", 5 << 12) + bytes(8), None, MailboxError.UNSUPPORTED_SERVICE),
        (COE, struct.pack("<H", 2 << 12) + bytes(7), None, MailboxError.SIZE_TOO_SHORT),
    ],
)
def test_error_replies(kind, body, length, detail):
    bench = Bench(Sample()).preop()
    assert bench.post(kind, body, length=length) == 1
    assert bench.fetch() == (0, struct.pack("<HH", 1, detail))
    assert bench.upload(0x1000) == struct.pack("<I", 0x1389), "the mailbox still works"


def test_repeat_request_of_the_master():
    bench = Bench(Sample()).preop()
    bench.post(COE, UPLOAD)
    lost = bench.fetch()
    activate = 0x0808 + 6
    bench.write(activate, bytes([1 | REPEAT]))
    bench.pump()
    assert bench.read(0x0808 + 7, 1)[0] & REPEAT, "acknowledged"
    assert bench.fetch() == lost
    assert bench.fetch() is None


def test_repeat_request_while_the_mailbox_is_off():
    """The answer is lost with it; those that follow are not."""
    bench = Bench(Sample()).preop()
    bench.post(COE, UPLOAD)
    bench.write(0x0808 + 6, b"\0")
    bench.write(0x0808 + 6, bytes([REPEAT]))
    bench.pump()
    bench.write(0x0808 + 6, bytes([1 | REPEAT]))
    bench.pump()
    bench.fetch()
    bench.run()
    assert bench.upload(0x1000) == struct.pack("<I", 0x1389)


def test_unread_answers_fill_the_mailbox_and_none_is_lost():
    bench = Bench(Sample()).preop()
    taken = 0
    while bench.post(COE, UPLOAD) and taken < 1000:
        taken += 1
    assert 10 < taken < 1000
    assert bench.post(COE, UPLOAD, counter=0) == 0, "full"
    answers = 0
    while bench.fetch() is not None:
        answers += 1
        bench.run()
    assert answers == taken, "the last one waited in the mailbox of the master"


def test_a_mail_written_before_preop_is_answered_in_preop():
    bench = Bench(Sample())
    bench.set_mailboxes()
    assert bench.post(COE, UPLOAD) == 1
    assert bench.fetch() is None
    assert bench.request(PREOP) == (PREOP, 0)
    assert bench.run().fetch() is not None


def test_init_empties_the_mailboxes():
    bench = Bench(Sample()).preop()
    bench.post(COE, UPLOAD)
    bench.post(COE, UPLOAD)
    assert bench.request(INIT) == (INIT, 0)
    assert bench.fetch() is None
    bench.preop()
    assert bench.fetch() is None


def test_answer_delay():
    bench = Bench(Sample()).preop()
    bench.device.answer_delay = 0.5
    bench.run().post(COE, UPLOAD)
    assert bench.run(0.45).fetch() is None
    assert bench.run(0.1).fetch() is not None


def test_slow():
    bench = Bench(Sample()).preop()
    bench.device.mailbox_fault = MailboxFault("slow", 0.2)
    bench.post(COE, UPLOAD)
    assert bench.run(0.15).fetch() is None
    assert bench.run(0.1).fetch() is not None
    bench.device.mailbox_fault = MailboxFault()
    bench.post(COE, UPLOAD)
    assert bench.fetch() is not None


def test_stuck():
    bench = Bench(Sample()).preop()
    bench.device.mailbox_fault = MailboxFault("stuck")
    for _ in range(100):
        assert bench.post(COE, UPLOAD) == 1, "mails are taken"
    bench.device.emergency(0x1000, 1)
    assert bench.run(10).fetch() is None
    bench.device.mailbox_fault = MailboxFault()
    bench.run()
    while bench.fetch() is not None:
        pass
    assert bench.upload(0x1000) == struct.pack("<I", 0x1389)


def test_full():
    bench = Bench(Sample()).preop()
    bench.device.mailbox_fault = MailboxFault("full")
    assert bench.post(COE, UPLOAD) == 1
    assert bench.run(1).post(COE, UPLOAD) == 0
    assert bench.fetch() is None
    bench.device.mailbox_fault = MailboxFault()
    assert bench.run().fetch() is not None, "the mail that lay there is answered"


def test_garbage_is_the_same_each_time():
    def answers():
        bench = Bench(Sample()).preop()
        bench.device.mailbox_fault = MailboxFault("garbage")
        found = []
        for _ in range(3):
            bench.post(COE, UPLOAD)
            found.append(bench.read(*bench.sizes[1]))
            bench.pump()
        return found

    found = answers()
    assert found == answers()
    assert len(set(found)) == 3
    assert all(mail[:6] != struct.pack("<HHBB", 10, 0, 0, 0x13) for mail in found)


def test_modes_are_those_of_the_documentation():
    assert list(MailboxMode) == ["none", "slow", "stuck", "full", "garbage"]
    with pytest.raises(UsageError, match=naming("'sleepy'", "none", "slow")):
        MailboxFault("sleepy")
    with pytest.raises(UsageError, match=naming("no mailbox")):
        Device().mailbox_fault = MailboxFault("full")


class Everything(Device):
    """All services and everything variable."""

    order = "Everything"
    mailbox = Mailbox(protocols=0x0C, coe_details=0x3F)
    variable_assignment = variable_mapping = sync_parameters = True
    rx_pdos = (Pdo(0x1600, "Out", 2, [Entry(0x7000, 1, "Out", DataType.UNSIGNED16, 16)]),)
    tx_pdos = (Pdo(0x1A00, "In", 3, [Entry(0x6000, 1, "In", DataType.REAL32, 32)]),)


_INDICES = st.sampled_from([0x1600, 0x1A00, 0x1C12, 0x1C13, 0x1C32, 0x1001, 0x7000, 0x1008])
_SDOS = st.builds(
    lambda command, index, subindex, data: (
        COE,
        struct.pack("<HBHB", 2 << 12, command, index, subindex) + data.ljust(4, b"\0"),
    ),
    st.integers(0, 255),
    _INDICES,
    st.integers(0, 3),
    st.binary(max_size=100)
    | st.sampled_from([b"\0", b"\1", b"\2", bytes.fromhex("10000070"), bytes.fromhex("0016")]),
)
_FOES = st.builds(
    lambda operation, number, data: (FOE, struct.pack("<BxI", operation, number) + data),
    st.integers(0, 7),
    st.integers(0, 3),
    st.binary(max_size=116),
)
_ANYTHING = st.tuples(st.integers(0, 15), st.binary(max_size=122))


@settings(max_examples=200)
@given(st.lists(_SDOS | _FOES | _ANYTHING, max_size=30))
def test_no_row_of_mails_does_harm(mails):
    bench = Bench(Everything()).preop()
    for protocol, body in mails:
        assert bench.post(protocol, body) == 1
        bench.run()
        while bench.fetch() is not None:
            pass
    bench.set_process_data()
    bench.request(SAFEOP)
    bench.run()
    bench.device.reset()
    bench.safeop().op(b"\5\0").run()
    assert bench.device[0x7000, 1] == 5
    assert bench.upload(0x1000) == struct.pack("<I", 0x1389)
