"""A capture of a master on a simulated segment, in all formats that are read."""

import struct
from contextlib import suppress
from dataclasses import replace

from slave_bench import Bench

from ecatd.base.errors import SdoAbortError
from ecatd.base.pcapng import Frame, header, packet
from ecatsim.devices.generic_drive import CiA402Drive

LRW, BRD = 12, 7
LOGICAL, CYCLES, CYCLE_NS = 0x0001_0000, 50, 2_000_000
LOST, SHORT = 20, 30  # cycles whose frame is lost, and comes back with another counter
SOURCE, BACK = b"\0\x11\x22\x33\x44\x55", b"\x02\x11\x22\x33\x44\x55"


class RecordingBench(Bench):
    """Keeps what it sends, and what comes back, with a time."""

    def __init__(self, *devices):
        self.frames = []
        self.at_ns = 1_700_000_000 * 10**9
        super().__init__(*devices)

    def datagram(self, command, address, data, *, lost=False, add=0):
        body = struct.pack("<BBIHH", command, len(self.frames) & 0x7F, address, len(data), 0)
        body += data + b"\0\0"
        raw = b"\xff" * 6 + SOURCE + b"\x88\xa4" + struct.pack("<H", len(body) | 0x1000) + body
        raw = raw.ljust(60, b"\0")
        answer = bytearray(self.segment.process(raw))
        at = 26 + len(data)
        wkc = int.from_bytes(answer[at : at + 2], "little") + add
        answer[at : at + 2] = wkc.to_bytes(2, "little")
        self.frames.append(Frame(self.at_ns, 0, True, raw))
        self.at_ns += 10_000
        if not lost:
            self.frames.append(Frame(self.at_ns, 0, False, bytes(answer)))
        self.at_ns += 10_000
        return bytes(answer[26 : 26 + len(data)]), wkc


def sample():
    """The frames of a start to OP, of SDOs, and of cycles with two faults."""
    drive = CiA402Drive()
    drive.chip = replace(drive.chip, eeprom_read_us=0)  # each look whether it is busy is a frame
    bench = RecordingBench(drive)
    bench.datagram(BRD, 0x0130 << 16, bytes(2))
    bench.write(0x0010, b"\x01\x10")
    bench.read(0x0000, 10)
    words = len(bench.device.sii_image()) // 2
    for word in range(0, words, 4):
        bench.write(0x0502, struct.pack("<HI", 0x0100, word))
        if bench.read(0x0508, 8)[:2] == b"\xff\xff" and word >= 0x40:
            break
    bench.safeop()
    bench.upload(0x1018, 1)
    bench.upload(0x1008)
    bench.download(0x6065, 0, b"\xd2\x04\0\0")
    with suppress(SdoAbortError):
        bench.upload(0x5555)
    sizes = {kind: (start, size) for _, start, size, _, _, kind in bench.defaults()}
    at = LOGICAL
    for number, kind in enumerate((3, 4)):
        start, size = sizes[kind]
        row = struct.pack("<IHBBHBBB3x", at, size, 0, 7, start, 0, 2 if kind == 3 else 1, 1)
        bench.write(0x0600 + 16 * number, row)
        at += size
    length = at - LOGICAL
    bench.request(8)
    for cycle in range(CYCLES):
        bench.at_ns = bench.at_ns // CYCLE_NS * CYCLE_NS + CYCLE_NS
        bench.datagram(
            LRW, LOGICAL, bytes(length), lost=cycle == LOST, add=-1 if cycle == SHORT else 0
        )
        bench.run()
    bench.al()
    bench.device.emergency(0x5112, 0x04, b"\1\2\3\4\5")
    bench.run()
    bench.fetch()
    bench.segment.close()
    return bench.frames, (sizes[3][1], sizes[4][1]), words


def pcapng(frames):
    """As `ecatctl capture` writes it."""
    return header(["eth0"]) + b"".join(packet(frame, 0) for frame in frames)


def pcapng_big(frames):
    """In the other byte order, with microseconds, a simple packet and a block of another kind."""

    def block(kind, body):
        body = body.ljust(-(-len(body) // 4) * 4, b"\0")
        size = struct.pack(">I", len(body) + 12)
        return struct.pack(">I", kind) + size + body + size

    text = block(0x0A0D0D0A, struct.pack(">IHHq", 0x1A2B3C4D, 1, 0, -1))
    text += block(1, struct.pack(">HHI", 1, 0, 0)) + block(5, bytes(12))
    for frame in frames:
        time, size = frame.time_ns // 1000, len(frame.data)
        head = struct.pack(">IIIII", 0, time >> 32, time & 0xFFFFFFFF, size, size)
        text += block(6, head + frame.data)
    return text


def pcap(frames, order="<", nanoseconds=False, link=1, cover=bytes):
    """The older format; `cover` changes each frame."""
    magic = 0xA1B23C4D if nanoseconds else 0xA1B2C3D4
    text = struct.pack(f"{order}IHHiIII", magic, 2, 4, 0, 0, 65535, link)
    for frame in frames:
        data = cover(frame.data)
        seconds, rest = divmod(frame.time_ns, 10**9)
        part = rest if nanoseconds else rest // 1000
        text += struct.pack(f"{order}IIII", seconds, part, len(data), len(data)) + data
    return text


def tagged(data):
    """With a VLAN tag."""
    return data[:12] + b"\x81\0\0\x05" + data[12:]


def cooked(data):
    """As Linux captures on `any`."""
    return b"\0\0\0\1\0\6" + data[6:12] + b"\0\0" + data[12:]


def over_udp(data):
    """EtherCAT over UDP."""
    udp = struct.pack(">HHHH", 0x88A4, 0x88A4, 8 + len(data) - 14, 0) + data[14:]
    ip = struct.pack(">BBHIBBHII", 0x45, 0, 20 + len(udp), 0, 64, 17, 0, 1, 2)
    return data[:12] + b"\x08\0" + ip + udp
