"""FoE: files over the mailbox, packet by packet (ETG.1000.6 "File access over EtherCAT")."""

import struct

import pytest
from slave_bench import BOOT, COE, FOE, Bench

from ecatsim import Device, Mailbox
from ecatsim.slave.foe import FoeCode, FoeError

READ, WRITE, DATA, ACK, ERR, BUSY = 1, 2, 3, 4, 5, 6
ROOM = 128 - 12  # bytes of a file in a mail


class Filer(Device):
    order = "Filer"
    mailbox = Mailbox(protocols=0x0C)
    bootstrap = Mailbox(0x1000, 64, 0x1080, 96)
    files = {"small.txt": b"hello", "empty": b"", "exact": bytes(ROOM)}  # noqa: RUF012
    file_limit = 1000
    firmware_files = ("firmware.efw",)

    def on_file(self, name, data, password):
        if data.startswith(b"bad"):
            raise FoeError(FoeCode.PROGRAM_ERROR, "this is no firmware")
        super().on_file(name, data, password)


def request(bench, operation, number, rest=b""):
    """The answer: operation, number and the rest; None if there is none."""
    assert bench.post(FOE, struct.pack("<BxI", operation, number) + rest) == 1
    mail = bench.fetch()
    if mail is None:
        return None
    assert mail[0] == FOE
    return (*struct.unpack_from("<BxI", mail[1]), mail[1][6:])


def read(bench, name, password=0):
    data, answer, packet = b"", request(bench, READ, password, name), 0
    room = bench.sizes[1][1] - 12
    while True:
        if answer[0] == ERR:
            raise FoeError(answer[1], answer[2].decode())
        packet += 1
        assert answer[:2] == (DATA, packet)
        data += answer[2]
        last = len(answer[2]) < room
        answer = request(bench, ACK, packet)
        if last:
            assert answer is None
            return data


def write(bench, name, data, password=0):
    room = bench.sizes[0][1] - 12
    answer, packet = request(bench, WRITE, password, name), 0
    while True:
        if answer[0] == ERR:
            raise FoeError(answer[1], answer[2].decode())
        if answer[0] == BUSY:
            part = data[(packet - 1) * room : packet * room]
            answer = request(bench, DATA, packet, part)
            continue
        assert answer == (ACK, packet, b"")
        if packet and len(data) < packet * room:
            return
        part = data[packet * room : (packet + 1) * room]
        packet += 1
        answer = request(bench, DATA, packet, part)


def code(function, *arguments):
    with pytest.raises(FoeError) as caught:
        function(*arguments)
    return caught.value.code


def test_read():
    bench = Bench(Filer()).preop()
    assert read(bench, b"small.txt") == b"hello"
    assert read(bench, b"empty") == b""
    assert read(bench, b"exact") == bytes(ROOM)


@pytest.mark.parametrize("size", [0, 1, ROOM - 1, ROOM, ROOM + 1, 2 * ROOM, 1000])
def test_every_length_comes_back(size):
    bench = Bench(Filer()).preop()
    data = bytes(i * 7 & 0xFF for i in range(size))
    write(bench, b"new.bin", data)
    assert bench.device.files["new.bin"] == data
    assert read(bench, b"new.bin") == data


def test_last_packet_is_one_that_does_not_fill_the_mailbox():
    bench = Bench(Filer()).preop()
    assert request(bench, READ, 0, b"exact")[2] == bytes(ROOM)
    assert request(bench, ACK, 1) == (DATA, 2, b"")
    assert request(bench, ACK, 2) is None
    request(bench, WRITE, 0, b"new")
    request(bench, DATA, 1, bytes(ROOM))
    assert "new" not in bench.device.files
    request(bench, DATA, 2)
    assert bench.device.files["new"] == bytes(ROOM)


def test_unknown_and_too_large_files():
    bench = Bench(Filer()).preop()
    assert code(read, bench, b"gone") == FoeCode.NOT_FOUND
    assert code(write, bench, b"big", bytes(1001)) == FoeCode.DISK_FULL
    assert "big" not in bench.device.files


def test_password():
    bench = Bench(Filer()).preop()
    bench.device.file_password = 0x1234
    assert code(read, bench, b"small.txt") == FoeCode.ACCESS_DENIED
    assert code(write, bench, b"new", b"x", 1) == FoeCode.ACCESS_DENIED
    assert read(bench, b"small.txt", 0x1234) == b"hello"


def test_wrong_packet_number_ends_the_transfer():
    bench = Bench(Filer()).preop()
    request(bench, WRITE, 0, b"new")
    assert request(bench, DATA, 2, b"x")[:2] == (ERR, FoeCode.PACKET_NUMBER)
    assert request(bench, DATA, 1, b"x")[:2] == (ERR, FoeCode.ILLEGAL)
    request(bench, READ, 0, b"exact")
    assert request(bench, ACK, 7)[:2] == (ERR, FoeCode.PACKET_NUMBER)
    assert request(bench, ACK, 1)[:2] == (ERR, FoeCode.ILLEGAL)


def test_what_does_not_fit_the_transfer():
    bench = Bench(Filer()).preop()
    assert request(bench, DATA, 1, b"x")[:2] == (ERR, FoeCode.ILLEGAL)
    assert request(bench, ACK, 0)[:2] == (ERR, FoeCode.ILLEGAL)
    assert request(bench, 9, 0)[:2] == (ERR, FoeCode.ILLEGAL)
    bench.post(FOE, b"\1\0")
    assert bench.fetch() == (0, struct.pack("<HH", 1, 6)), "mailbox error: too short"


def test_master_ends_a_transfer():
    bench = Bench(Filer()).preop()
    request(bench, WRITE, 0, b"new")
    assert request(bench, ERR, FoeCode.NOT_DEFINED) is None
    assert request(bench, DATA, 1, b"x")[:2] == (ERR, FoeCode.ILLEGAL)


def test_busy_device_is_sent_the_packet_again():
    bench = Bench(Filer()).preop()
    bench.device.file_busy = 2
    request(bench, WRITE, 0, b"new")
    answers = [request(bench, DATA, 1, b"data") for _ in range(3)]
    assert [(a[0], a[1] & 0xFFFF, a[1] >> 16) for a in answers[:2]] == [(BUSY, 0, 2), (BUSY, 1, 2)]
    assert answers[2] == (ACK, 1, b"")
    data = bytes(range(200))
    write(bench, b"long", data)
    assert bench.device.files["long"] == data


def test_busy_master_gets_the_packet_again():
    bench = Bench(Filer()).preop()
    first = request(bench, READ, 0, b"small.txt")
    assert request(bench, BUSY, 0) == first


def test_device_refuses_a_file():
    bench = Bench(Filer()).preop()
    with pytest.raises(FoeError, match="this is no firmware") as caught:
        write(bench, b"x", b"bad data")
    assert caught.value.code == FoeCode.PROGRAM_ERROR


def test_firmware_is_taken_in_boot_only_and_through_the_bootstrap_mailbox():
    bench = Bench(Filer()).preop()
    assert code(write, bench, b"firmware.efw", b"x") == FoeCode.BOOTSTRAP_ONLY
    bench.request(1)
    bench.set_sm(0, 0x1000, 64, 0x26)
    bench.set_sm(1, 0x1080, 96, 0x22)
    assert bench.request(BOOT) == (BOOT, 0)
    data = bytes(range(250))
    write(bench, b"firmware.efw", data)
    assert bench.device.files["firmware.efw"] == data
    assert read(bench, b"firmware.efw") == data
    bench.post(COE, bytes(10))
    assert bench.fetch() == (0, struct.pack("<HH", 1, 2)), "there is no CoE in BOOT"


def test_state_change_ends_a_transfer():
    bench = Bench(Filer()).preop()
    request(bench, WRITE, 0, b"new")
    bench.request(1)
    bench.preop()
    assert request(bench, DATA, 1, b"x")[:2] == (ERR, FoeCode.ILLEGAL)


def test_no_foe_without_the_protocol():
    class Plain(Filer):
        mailbox = Mailbox()

    bench = Bench(Plain()).preop()
    bench.post(FOE, struct.pack("<BxI", READ, 0) + b"small.txt")
    assert bench.fetch() == (0, struct.pack("<HH", 1, 2))


def test_devices_have_files_of_their_own():
    first, second = Filer(), Filer()
    first.files["x"] = b""
    assert "x" not in second.files
    assert "x" not in Filer.files
