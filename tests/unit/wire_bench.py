"""The way of `Datagrams` to simulated slaves in the same process, on which frames can get lost."""

from __future__ import annotations

import math
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from ecatd.master.frames.datagrams import Datagrams, apwr, source_address
from ecatsim.esc import Chip, Event, Segment
from ecatsim.slave.device import Device
from ecatsim.slave.sii import Description, build

SOURCE = source_address(0, int.from_bytes(b"test", "little"))
FIRST_STATION = 0x1001
PREOP = 2
_TICK = 0.001


class Wire:
    """Frames on their way, and how many times each is to get lost.

    Attributes:
        frames: All that were sent.
        lose: Told each frame by its number; true: it does not come back.
        unseen: Whether lost frames get lost before the slaves have seen them.
    """

    def __init__(self) -> None:
        self.frames: list[bytes] = []
        self.lose: Callable[[int], bool] = lambda _number: False
        self.unseen = False


@contextmanager
def served(
    segment: Segment,
    count: int,
    react: Callable[[], None] = lambda: None,
    timeout: float = 0.02,
) -> Iterator[tuple[Datagrams, Wire]]:
    """Register access to the slaves of a segment, which get their station addresses.

    Args:
        segment: The segment; it is closed in the end.
        count: How many slaves it has.
        react: Called after each frame and each millisecond, by the thread that serves.
        timeout: Seconds after which a frame is lost. A test that counts frames has patience, so
            that none is sent again because the machine is busy.
    """
    wire = Wire()
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    theirs.settimeout(_TICK)

    def serve() -> None:
        while True:
            frame = None
            try:
                frame = theirs.recv(2048)
            except TimeoutError:
                pass
            except ConnectionResetError:  # closed with an answer unread, which came too late
                return
            if frame == b"":
                return
            if frame is not None:
                wire.frames.append(frame)
                lost = wire.lose(len(wire.frames) - 1)
                answer = b"" if lost and wire.unseen else segment.process(frame)
                if not lost:
                    with suppress(BrokenPipeError):
                        theirs.send(answer)
            react()

    thread = threading.Thread(target=serve)
    thread.start()
    registers = Datagrams(ours, SOURCE, timeout)
    registers.exchange(
        [apwr(i, 0x0010, struct.pack("<H", FIRST_STATION + i)) for i in range(count)]
    )
    wire.frames.clear()
    try:
        yield registers, wire
    finally:
        registers.close()
        thread.join()
        theirs.close()
        segment.close()


@contextmanager
def in_preop(*devices: Device, timeout: float = 0.02) -> Iterator[tuple[Datagrams, Wire]]:
    """Devices whose mailboxes work; `timeout` as for `served`."""
    segment = Segment()
    for device in devices:
        device.attach(segment, 0, 0)

    def react() -> None:
        now = time.monotonic()
        for position, event in segment.wait(0):
            devices[position].handle(event, now)
        for device in devices:
            device.run(now)

    with served(segment, len(devices), react, timeout) as (registers, wire):
        for position, device in enumerate(devices):
            box = device.mailbox
            assert box is not None
            set_mailboxes(
                registers,
                position,
                (box.receive, box.receive_size),
                (box.send, box.send_size),
            )
        registers.exchange([apwr(i, 0x0120, bytes([PREOP, 0])) for i in range(len(devices))])
        while any(device.machine.state != PREOP for device in devices):
            time.sleep(_TICK)
        wire.frames.clear()
        yield registers, wire


def set_mailboxes(
    registers: Datagrams, position: int, out: tuple[int, int], back: tuple[int, int]
) -> None:
    """Sets the sync managers of a mailbox up, as a master does."""
    for number, (area, control) in enumerate(((out, 0x26), (back, 0x22))):
        content = struct.pack("<HHBBBB", *area, control, 0, 1, 0)
        registers.exchange([apwr(position, 0x0800 + 8 * number, content)])


Answers = Callable[[bytes], list[bytes]]
"""The mails by which a slave answers a mail."""


class Correspondent:
    """The device behind a controller, whose mails a test makes up.

    Attributes:
        answers: Makes the answers to a mail.
        mails: All that came.
        repeats: Whether it knows the repeat request of a master that has lost a mail.
        pause: Seconds after which it takes a mail, by the number of the mail.
    """

    def __init__(self, answers: Answers, *, repeats: bool = True) -> None:
        self.answers = answers
        self.mails: list[bytes] = []
        self.repeats = repeats
        self.pause: dict[int, float] = {}
        self._take_at = math.inf
        self._waiting: list[bytes] = []
        self._offered: list[bytes] = []
        self._unread = False

    def handle(self, segment: Segment, position: int, event: Event) -> None:
        """Reacts to what the master did."""
        if event & Event.MAILBOX_OUT:
            self._unread = False
        if event & Event.MAILBOX_AGAIN and self.repeats and self._offered:
            if self._unread and len(self._offered) > 1:
                self._waiting.insert(0, self._offered.pop())
            segment.put_mail(position, self._offered[-1], again=True)
            self._unread = True
        if event & Event.MAILBOX_IN:
            self._take_at = time.monotonic() + self.pause.get(len(self.mails), 0)
        if time.monotonic() >= self._take_at:
            self._take_at = math.inf
            self.mails.append(segment.take_mail(position))
            self._waiting += self.answers(self.mails[-1])
        if self._waiting and not self._unread and segment.put_mail(position, self._waiting[0]):
            self._offered.append(self._waiting.pop(0))
            self._unread = True


@contextmanager
def corresponding(*slaves: Correspondent, size: int = 128) -> Iterator[tuple[Datagrams, Wire]]:
    """Slaves whose mails the test makes up, with mailboxes of `size` bytes."""
    segment = Segment()
    for _ in slaves:
        segment.add(Chip(), build(Description(1, 2, 3)))

    def react() -> None:
        events = dict(segment.wait(0))
        for position, slave in enumerate(slaves):
            slave.handle(segment, position, events.get(position, Event(0)))

    with served(segment, len(slaves), react) as (registers, wire):
        for position in range(len(slaves)):
            set_mailboxes(registers, position, (0x1000, size), (0x1000 + size, size))
        wire.frames.clear()
        yield registers, wire
