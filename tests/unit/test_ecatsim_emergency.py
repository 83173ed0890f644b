"""Emergencies: content, error register, and the states in which they are sent."""

import struct

import pytest
from slave_bench import COE, ERROR, INIT, PREOP, SAFEOP, Bench

from conftest import naming
from ecatd.etg.pdo import Entry, Pdo
from ecatsim import Access, Device, Mailbox


class Sample(Device):
    order = "Sample"
    mailbox = Mailbox()
    rx_pdos = (Pdo(0x1600, "Out", 2, [Entry(0x7000, 1, "Out", 6, 16)]),)
    tx_pdos = (Pdo(0x1A00, "In", 3, [Entry(0x6000, 1, "In", 6, 16)]),)


def emergency(mail):
    protocol, body = mail
    header, code, register = struct.unpack_from("<HHB", body)
    assert (protocol, header >> 12, len(body)) == (COE, 1, 10)
    return code, register, body[5:]


def test_emergency_and_its_reset():
    bench = Bench(Sample()).preop()
    bench.device.emergency(0x8130, 0x11, b"abc")
    assert emergency(bench.fetch()) == (0x8130, 0x11, b"abc\0\0")
    assert bench.upload(0x1001) == b"\x11"
    bench.device.emergency(0, 0)
    assert emergency(bench.fetch()) == (0, 0, bytes(5))
    assert bench.upload(0x1001) == b"\0"


def test_emergencies_wait_for_each_other_and_for_answers():
    bench = Bench(Sample()).preop()
    for code in (0x1000, 0x2000, 0x3000):
        bench.device.emergency(code, 1)
    assert [emergency(bench.fetch())[0] for _ in range(3)] == [0x1000, 0x2000, 0x3000]
    assert bench.fetch() is None


def test_emergency_from_within_a_request_comes_behind_the_answer():
    device = Sample()
    trigger = device.dictionary.variable(0x2000, "Trigger", 6, 0, Access.RW)
    trigger.on_write = lambda value: device.emergency(value, 1)
    bench = Bench(device).preop()
    bench.download(0x2000, 0, b"\x30\x81")
    assert emergency(bench.fetch()) == (0x8130, 1, bytes(5))
    assert bench.fetch() is None


def test_no_emergency_in_init():
    bench = Bench(Sample())
    bench.set_mailboxes()
    bench.device.emergency(0x1000, 1)
    assert bench.fetch() is None
    assert bench.request(PREOP) == (PREOP, 0)
    assert bench.fetch() is None
    assert bench.upload(0x1001) == b"\1"
    assert bench.request(INIT) == (INIT, 0)


def test_emergencies_that_nobody_reads_do_not_fill_the_memory():
    bench = Bench(Sample()).preop()
    for _ in range(10_000):
        bench.device.emergency(0x1000, 1)
    assert 0 < sum(1 for _ in iter(bench.fetch, None)) < 1000


@pytest.mark.parametrize("arguments", [(0x10000, 0), (0, 0x100), (0, 0, b"123456"), (-1, 0)])
def test_numbers_that_do_not_fit(arguments):
    with pytest.raises(ValueError, match=naming("code", "16 bits")):
        Sample().emergency(*arguments)


def test_device_without_a_mailbox_keeps_the_register():
    device = Device()
    Bench(device)
    device.emergency(0x1000, 4)
    assert device[0x1001, 0] == 4


def test_refused_safeop_is_an_emergency_where_the_device_wants_it():
    bench = Bench(Sample()).preop()
    bench.set_process_data(outputs=3)
    assert bench.request(SAFEOP) == (PREOP | ERROR, 0x1D)
    assert bench.fetch() is None
    bench.device.state_emergencies = True
    bench.request(PREOP | 0x10)
    assert bench.request(SAFEOP) == (PREOP | ERROR, 0x1D)
    code, register, data = emergency(bench.fetch())
    assert (code, register) == (0xA000, 0)
    assert struct.unpack("<BHH", data) == (4 * 2 + 0, 2, 2), "length of SM2: 2 bytes are allowed"
