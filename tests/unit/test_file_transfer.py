"""Files over EtherCAT: the master's side against the slave's side of the simulator."""

import itertools
from collections.abc import Callable

import pytest

from conftest import names, naming
from ecatd.base.errors import NoAnswerError, StateError
from ecatd.base.timeouts import Timeout
from ecatd.master.mailbox import foe
from ecatd.master.mailbox.conversation import Conversation
from ecatd.master.mailbox.foe import FileRead, FileTransfer, FileWrite
from ecatd.master.mailbox.mailbox import HEADER_BYTES, Mailbox, Protocol
from ecatsim.slave.foe import FoeServer

SIZE = 64
FULL = SIZE - HEADER_BYTES - 6
MOST = 100_000


class Host:
    """What a device has for its files."""

    def __init__(self) -> None:
        self.files: dict[str, bytes] = {}
        self.file_password: int | None = None
        self.file_limit = 10_000
        self.firmware_files = ("firmware",)
        self.file_busy = 0

    def on_file(self, name: str, data: bytes, password: int) -> None:
        del password
        self.files[name] = data


class Wire(Mailbox):
    """A mailbox whose messages go to a server in this process, and may be changed on their way."""

    def __init__(self, answer: Callable[[bytes], list[bytes]]) -> None:
        self._answers = answer
        self._waiting: list[bytes] = []

    size = size_in = SIZE  # type: ignore[assignment]

    def ask(self, protocol, body, take, patience_s=None):  # type: ignore[no-untyped-def]
        assert protocol == Protocol.FOE
        assert len(body) <= SIZE - HEADER_BYTES
        self._waiting += self._answers(body)
        while self._waiting:
            taken = take(self._waiting.pop(0))
            if taken is not None:
                return taken
        raise NoAnswerError("nothing")
        yield []

    def send(self, protocol: Protocol, body: bytes) -> Conversation[None]:
        assert protocol == Protocol.FOE
        assert self._answers(body) == []
        return
        yield []


def served(host: Host, *, boot: bool = False) -> Wire:
    server = FoeServer(host)
    server.start(SIZE, SIZE, boot=boot)
    return Wire(server.handle)


def finish(file: FileTransfer, mailbox: Mailbox, packets: int = 3) -> bytes:
    while not file.ended:
        for _ in file.go_on(mailbox, packets):
            pass
    return bytes(file.data)


@pytest.mark.parametrize("size", [0, 1, FULL - 1, FULL, FULL + 1, 3 * FULL, 1000])
@pytest.mark.parametrize("busy", [0, 2])
def test_files_go_both_ways(size: int, busy: int) -> None:
    host, data = Host(), bytes(itertools.islice(itertools.cycle(range(251)), size))
    host.file_busy = busy
    written = FileWrite("a.bin", 0, bytearray(data))
    finish(written, served(host))
    assert host.files == {"a.bin": data}
    assert written.moved == size
    read = FileRead("a.bin", 0, MOST)
    assert finish(read, served(host)) == data
    assert read.moved == size


def test_what_a_slave_refuses_is_said() -> None:
    host = Host()
    host.file_password = 5
    for file, code, word in (
        (FileRead("a", 5, MOST), "0x8001", "there is no file a"),
        (FileRead("a", 4, MOST), "0x8002", "--password"),
        (FileWrite("firmware", 5, bytearray(b"x")), "0x8008", "--boot"),
        (FileWrite("big", 5, bytearray(20_000)), "0x8003", "10000 bytes"),
    ):
        with pytest.raises(StateError) as caught:
            finish(file, served(host))
        names(str(caught.value), code, word)


def test_a_file_without_end_is_given_up() -> None:
    numbers = itertools.count(1)

    def endless(_body: bytes) -> list[bytes]:
        return [b"\3\0" + next(numbers).to_bytes(4, "little") + bytes(FULL)]

    with pytest.raises(StateError, match=str(MOST)):
        finish(FileRead("a", 0, MOST), Wire(endless))


@pytest.mark.parametrize("file", [FileRead("a", 0, MOST), FileWrite("a", 0, bytearray(9))])
def test_a_slave_that_is_busy_for_ever(file: FileTransfer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Others get their turns meanwhile, and the transfer has an end."""
    monkeypatch.setattr(foe, "_TURN_S", 0.01)
    monkeypatch.setattr(foe, "_PATIENCE", Timeout(0.2))
    wire, turns = Wire(lambda _: [b"\6\0\1\0\2\0soon"]), 0
    with pytest.raises(NoAnswerError, match=naming("0.2 s", "'1 of 2, soon'", "off")):
        while not file.ended:
            turns += 1
            for _ in file.go_on(wire, 3):
                pass
    assert turns > 2


def test_late_and_malformed_answers() -> None:
    late = FileRead("a", 0, MOST)
    first = [b"\4\0\7\0\0\0", b"\3\0\1\0\0\0end"]  # an acknowledgement of another transfer

    def answer(body: bytes) -> list[bytes]:
        return first if body[0] == 1 else []

    assert finish(late, Wire(answer)) == b"end"
    with pytest.raises(StateError, match="wrong frame"):
        finish(FileRead("a", 0, MOST), Wire(lambda _: [b"\3\0\1"]))


def test_texts_of_a_slave_are_cleaned() -> None:
    error = b"\5\0\0\x80\0\0" + b"\x1b[31mbad\0rest"
    with pytest.raises(StateError) as caught:
        finish(FileRead("a", 0, MOST), Wire(lambda _: [error]))
    assert "\x1b" not in str(caught.value)
    names(str(caught.value), "?[31mbad")
