"""SYNC signals as a device wants them: AL status codes, and the objects 0x1C32 and 0x1C33."""

import struct

import pytest
from slave_bench import ACK, ERROR, OP, PREOP, SAFEOP, Bench

from ecatd.base.errors import SdoAbortError
from ecatd.etg import error_codes
from ecatd.etg.pdo import Entry, Pdo
from ecatsim import DcMode, Device, Mailbox
from ecatsim.esc import Event

ACTIVATION, START_TIME, CYCLE_TIME = 0x0981, 0x0990, 0x09A0
RUN, SYNC0, SYNC1 = 0x01, 0x02, 0x04
MILLISECOND = 1_000_000


class Drive(Device):
    order = "Drive"
    mailbox = Mailbox()
    rx_pdos = (Pdo(0x1600, "Out", 2, [Entry(0x7000, 1, "Out", 6, 16)]),)
    tx_pdos = (Pdo(0x1A00, "In", 3, [Entry(0x6000, 1, "In", 6, 16)]),)
    dc_modes = (DcMode("Synchron", 0), DcMode("DC", 0x0300))
    minimum_cycle_ns = 250_000


class Deaf(Drive):
    """Is not told of SYNC pulses."""

    pdi_config = 0


class Plain(Drive):
    dc_modes = ()


def activate(bench, active, cycle_ns):
    """The first pulse would come in a far future: tests give the pulses themselves."""
    bench.write(ACTIVATION, b"\0")
    bench.write(START_TIME, struct.pack("<Q", 1 << 62))
    bench.write(CYCLE_TIME, struct.pack("<I", cycle_ns))
    bench.write(ACTIVATION, bytes([active]))


def prepared(device):
    bench = Bench(device).preop()
    bench.set_process_data()
    return bench


def value(bench, index, subindex):
    return int.from_bytes(bench.upload(index, subindex), "little")


@pytest.mark.parametrize(
    ("active", "cycle_ns", "code"),
    [
        (0, 0, 0),
        (RUN | SYNC0, MILLISECOND, 0),
        (RUN | SYNC0, 250_000, 0),
        (RUN | SYNC0 | SYNC1, MILLISECOND, 0x30),
        (RUN, MILLISECOND, 0x30),
        (SYNC0, MILLISECOND, 0x30),
        (RUN | SYNC0, 0, 0x35),
        (RUN | SYNC0, 249_999, 0x36),
    ],
)
def test_dc_settings(active, cycle_ns, code):
    bench = prepared(Drive())
    activate(bench, active, cycle_ns)
    assert bench.request(SAFEOP) == ((PREOP | ERROR, code) if code else (SAFEOP, 0))


def test_fixed_cycle_time():
    class Fixed(Drive):
        dc_modes = (DcMode("DC", 0x0300, 2 * MILLISECOND),)

    bench = prepared(Fixed())
    activate(bench, RUN | SYNC0, MILLISECOND)
    assert bench.request(SAFEOP) == (PREOP | ERROR, 0x35)
    activate(bench, RUN | SYNC0, 2 * MILLISECOND)
    assert bench.request(SAFEOP | ACK) == (SAFEOP, 0)


def test_device_without_dc_modes_does_not_care():
    bench = prepared(Plain())
    activate(bench, RUN | SYNC0 | SYNC1, 0)
    assert bench.request(SAFEOP) == (SAFEOP, 0)
    bench.op(b"\1\0")
    assert 0x1C32 not in bench.device.dictionary


def in_op(bench):
    activate(bench, RUN | SYNC0, MILLISECOND)
    assert bench.request(SAFEOP) == (SAFEOP, 0)
    bench.request(OP)
    bench.put(b"\1\0")
    bench.pump()


def test_op_waits_for_sync0():
    bench = prepared(Drive())
    in_op(bench)
    assert bench.al() == (SAFEOP, 0)
    bench.device.handle(Event.SYNC0, bench.now)
    assert bench.al() == (OP, 0)


def test_no_sync0():
    bench = prepared(Drive())
    in_op(bench)
    bench.now += 1.1
    bench.device.run(bench.now)
    assert bench.al() == (SAFEOP | ERROR, 0x2D)


def test_no_outputs_and_no_sync0():
    bench = prepared(Drive())
    activate(bench, RUN | SYNC0, MILLISECOND)
    bench.request(SAFEOP)
    bench.request(OP)
    bench.now += 1.1
    bench.device.run(bench.now)
    assert bench.al() == (SAFEOP | ERROR, 0x19)


def test_device_that_is_not_told_of_sync0_does_not_wait():
    bench = prepared(Deaf())
    in_op(bench)
    assert bench.al() == (OP, 0)


def test_sync0_that_stops_in_op():
    bench = prepared(Drive())
    in_op(bench)
    bench.device.handle(Event.SYNC0, bench.now)
    bench.device.run(bench.now)
    assert bench.al() == (OP, 0)
    bench.write(ACTIVATION, b"\0")
    bench.device.run(bench.now)
    assert bench.al() == (SAFEOP | ERROR, 0x2C)


def test_synchronization_objects():
    bench = prepared(Drive())
    assert value(bench, 0x1C32, 0) == 32
    assert [value(bench, 0x1C32, i) for i in (1, 2, 4, 5)] == [1, 0, 0x07, 250_000]
    assert value(bench, 0x1C33, 1) == 0x22, "inputs go with the outputs"
    activate(bench, RUN | SYNC0, MILLISECOND)
    assert bench.request(SAFEOP) == (SAFEOP, 0)
    assert [value(bench, 0x1C32, i) for i in (1, 2, 10)] == [2, MILLISECOND, MILLISECOND]
    assert bench.request(PREOP) == (PREOP, 0)
    assert [value(bench, 0x1C32, i) for i in (1, 2, 10)] == [1, 0, 0]


def test_what_the_master_writes_into_them():
    bench = prepared(Drive())
    bench.download(0x1C32, 2, struct.pack("<I", 500_000))
    assert value(bench, 0x1C32, 2) == 500_000
    for kind in (3, 7):
        with pytest.raises(SdoAbortError) as caught:
            bench.download(0x1C32, 1, struct.pack("<H", kind))
        assert caught.value.code == error_codes.VALUE_RANGE
    bench.download(0x1C32, 1, struct.pack("<H", 2))
    assert bench.request(SAFEOP) == (PREOP | ERROR, 0x30), "SYNC0 is not on"
    activate(bench, RUN | SYNC0, MILLISECOND)
    assert bench.request(SAFEOP | ACK) == (SAFEOP, 0)


def test_synchronization_objects_without_dc():
    class Free(Plain):
        sync_parameters = True

    bench = prepared(Free())
    assert value(bench, 0x1C32, 4) == 0x03
    with pytest.raises(SdoAbortError):
        bench.download(0x1C32, 1, struct.pack("<H", 2))
