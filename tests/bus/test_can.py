"""CAN behind terminals: clients that send and receive, share a channel, and end.

Terminals that fail come back.

Two terminals are on one simulated bus, so what one sends the other one receives.
"""

import contextlib
import itertools
import json
import os
import re
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from raw_slot import RawSlot

from conftest import PATIENCE, Daemon, names, run_module, stop_process, wait_for
from ecatd.base.errors import (
    BusyError,
    LeaseError,
    NoAnswerError,
    OwnedError,
    UnreachableError,
    UsageError,
)
from ecatd.client import Client
from ecatd.client.can import CanChannel, CanFrame, frame
from ecatd.shm import contract as shm
from ecatd.shm.contract import CanKind, CanState

pytestmark = pytest.mark.bus

RIG = """
name = "can-pair"
[[slave]]
device = "EK1100"
[[slave]]
device = "EL6751CAN"
[[slave]]
device = "EL6751CAN"
parameters = { handshake_cycles = 4 }
[[slave]]
device = "EL2008"
[[can]]
bit_rate = 500
terminals = [1, 2]
"""
CONFIG = """
[gateway]
listen = []
[outputs]
lease_max_ms = 1000
[[slave]]
position = 1
name = "left"
[slave.can]
bit_rate = 500
frames_per_second = 1000
bus_off_restart_ms = 100
[[slave.can.safe]]
id = 0x000
data = "02 00"
[[slave.can.safe]]
id = 0x201
data = "00 00"
period_ms = 20
identifiers = ["0x201"]
[[slave.can.safe]]
id = 0x202
identifiers = ["0x202"]
when = "ended"
[[slave]]
position = 2
name = "right"
[slave.can]
bit_rate = 500
frames_per_second = 1000
receive_queue = 30
"""
CYCLE_TIME_US = 2000
LEFT, RIGHT, EL2008 = 1, 2, 3
NMT_STOP, NOTHING, ENDED = (0x000, b"\2\0"), (0x201, b"\0\0"), (0x202, b"")


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("can") / "pair.toml"
    file.write_text(RIG)
    return file


@pytest.fixture(scope="module")
def daemon(start_shared: Callable[..., Daemon], rig: Path) -> Daemon:
    return start_shared(str(rig), config=CONFIG)


class Channel:
    """A client on one channel."""

    def __init__(self, client: Client, slave: int) -> None:
        self.client = client
        self.can: CanChannel = client.can(slave)
        self.seen: list[CanFrame] = []

    def take(self, enough: Callable[[list[CanFrame]], bool]) -> list[CanFrame]:
        """Reads until what was read since the last call is enough."""
        end = time.monotonic() + PATIENCE
        while not enough(self.seen):
            assert time.monotonic() < end, self.seen
            self.client.wait()
            while found := self.can.read():
                self.seen += found
        found, self.seen = self.seen, []
        return found

    def receive(self, count: int, identifier: int | None = None) -> list[CanFrame]:
        """Frames of other nodes: the terminal may still have those of the test before."""

        def wanted(seen: list[CanFrame]) -> list[CanFrame]:
            found = of_kind(seen, CanKind.RECEIVED)
            return [f for f in found if identifier in (None, f.identifier)]

        return wanted(self.take(lambda seen: len(wanted(seen)) >= count))


def of_kind(found: list[CanFrame], kind: CanKind) -> list[CanFrame]:
    return [item for item in found if item.kind == kind]


def contents(found: list[CanFrame]) -> list[tuple[int, bytes]]:
    return [(item.identifier, item.data) for item in found]


@contextmanager
def channel(daemon: Daemon, slave: int) -> Iterator[Channel]:
    with daemon.client() as client:
        found = Channel(client, slave)
        yield found
        if daemon.process.poll() is None:
            with contextlib.suppress(LeaseError, UnreachableError):
                found.can.release()


def simulator(daemon: Daemon, *arguments: str) -> str:
    """Runs `ecatsim ctl`."""
    result = run_module(
        "ecatsim", "ctl", "--name", str(daemon.child_pid("ecatsim")), *arguments, env=daemon.env
    )
    assert result.returncode == 0, result.stderr
    return result.stdout


@contextmanager
def program(daemon: Daemon, text: str) -> Iterator[subprocess.Popen[str]]:
    """A Python program beside the test; it has `can`, a channel that it has claimed."""
    head = f"""
        import time
        from ecatd.client import Client
        from ecatd.client.can import frame
        bus = Client({daemon.bus!r})
        can = bus.can({LEFT})
        can.claim()
    """
    source = textwrap.dedent(head) + textwrap.dedent(text)
    process = subprocess.Popen(
        [sys.executable, "-c", source], env=daemon.env, stdout=subprocess.PIPE, text=True
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()
        assert process.stdout is not None
        process.stdout.close()


def wait_for_line(process: subprocess.Popen[str]) -> None:
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"


# --- frames -----------------------------------------------------------------------------------


def test_all_kinds_of_frames_arrive_as_they_were_sent(daemon: Daemon) -> None:
    frames = [
        frame(0x123, b"\1\2\3"),
        frame(0x7FF, bytes(8)),
        frame(0x000, b""),
        frame(0x123, extended=True, data=b"\xff" * 8),
        frame(0x1FFFFFFF, b"x"),
        frame(0x321, remote=True, length=4),
        frame(0x18FF0001, remote=True),
    ]
    with channel(daemon, LEFT) as left, channel(daemon, RIGHT) as right:
        left.can.claim()
        last = left.can.send_all(frames)
        arrived = right.receive(len(frames))
        own = left.take(lambda seen: len(seen) >= len(frames))
    wanted = [(f.identifier, f.data, f.extended, f.remote, f.length) for f in frames]
    assert [(f.identifier, f.data, f.extended, f.remote, f.length) for f in arrived] == wanted
    assert [(f.identifier, f.data, f.extended, f.remote, f.length) for f in own] == wanted
    assert {f.kind for f in own} == {CanKind.SENT}
    assert [f.number for f in own] == list(range(last - len(frames) + 1, last + 1))
    assert all(f.sender == 0 for f in arrived)
    assert [f.cycle for f in arrived] == sorted(f.cycle for f in arrived)


def test_what_one_client_sends_the_others_on_the_channel_see(daemon: Daemon) -> None:
    with channel(daemon, LEFT) as one, channel(daemon, LEFT) as two, channel(daemon, LEFT) as third:
        one.can.claim()
        two.can.claim()
        one.can.send(0x101)
        two.can.send(0x102)
        for reader in (one, two, third):
            found = reader.take(lambda seen: len(seen) >= 2)
            assert {(f.identifier, f.sender) for f in found} == {
                (0x101, one.can.sender),
                (0x102, two.can.sender),
            }


def test_frames_of_a_sample_are_not_of_later_cycles(daemon: Daemon) -> None:
    with channel(daemon, LEFT) as left, channel(daemon, RIGHT) as right:
        left.can.claim()
        left.can.send_all([frame(0x100 + n) for n in range(20)])
        left.can.flush(PATIENCE)
        count = 0
        while count < 20:
            right.client.wait()
            right.client.sample()
            cycle = right.client.domain(0).cycle
            found = right.can.read(until_cycle=cycle)
            assert all(item.cycle <= cycle for item in found)
            count += len(found)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda can: can.send(0x800, extended=False), ["0x800", "11 bits"]),
        (lambda can: can.send(0x20000000), ["0x20000000", "29 bits"]),
        (lambda can: can.send(1, bytes(9)), ["8 bytes", "9"]),
        (lambda can: can.send(1, b"x", remote=True), ["remote", "no data"]),
        (lambda can: can.claim(reserve=[(0x20, 0x10)]), ["0x20", "0x10", "range"]),
        (lambda can: can.claim(reserve=list(range(9))), ["9 ranges", "8"]),
        (lambda can: can.claim(lease=-1), ["-1", "lease"]),
    ],
)
def test_what_is_no_frame_is_refused(
    daemon: Daemon, wrong: Callable[[CanChannel], object], words: list[str]
) -> None:
    with channel(daemon, LEFT) as left:
        left.can.claim()
        with pytest.raises(UsageError) as error:
            wrong(left.can)
        names(error.value, *words)
        left.can.send(0x100)  # it still is a sender
        left.can.flush(PATIENCE)


def test_the_process_data_of_a_terminal_belong_to_the_daemon(daemon: Daemon) -> None:
    with daemon.client() as client, pytest.raises(OwnedError) as error:
        client.claim(client.signal("left/0x7001:01"), lease=1)
    names(error.value, "left", "CAN frames", "[slave.can]")


def test_a_slave_without_can_says_so(daemon: Daemon) -> None:
    from ecatd.base.errors import StateError

    with daemon.client() as client, pytest.raises(StateError) as error:
        client.can(EL2008)
    names(error.value, "EL2008", "[slave.can]")


# --- several senders --------------------------------------------------------------------------


def test_a_sender_without_end_does_not_keep_others_back(daemon: Daemon) -> None:
    with channel(daemon, LEFT) as greedy, channel(daemon, LEFT) as modest:
        greedy.can.claim()
        modest.can.claim()
        found: list[CanFrame] = []
        numbers: list[int] = []
        for turn in range(40):
            while True:
                try:
                    greedy.can.send_all([frame(0x100)] * 64)
                except BusyError:
                    break
            if turn % 4 == 3:
                numbers.append(modest.can.send(0x200))
            greedy.client.wait()
            while news := greedy.can.read():
                found += news
        modest.can.flush(PATIENCE)
        while news := greedy.can.read():
            found += news
    order = [f.identifier for f in found]
    assert order.count(0x200) == len(numbers)
    # Each is in the next batch but one: it never waits for the whole queue of the other one.
    queue = 2 * daemon_queue(daemon)
    places = [i for i, identifier in enumerate(order) if identifier == 0x200]
    assert all(b - a <= 64 * 4 + queue for a, b in itertools.pairwise(places))
    assert order.count(0x100) > 4 * queue


def daemon_queue(daemon: Daemon) -> int:
    with daemon.client() as client:
        return client.can(LEFT).info.send_queue


def test_a_full_queue_is_told_and_nothing_is_lost(daemon: Daemon) -> None:
    with channel(daemon, LEFT) as left, channel(daemon, RIGHT) as right:
        left.can.claim()
        first = left.can.send(0x155, b"\0\0\0\0")
        count = last = 0
        while True:  # faster than the bus
            try:
                last = left.can.send_all(
                    [frame(0x155, n.to_bytes(4, "little")) for n in range(count + 1, count + 65)]
                )
                count = last - first
            except BusyError as error:
                names(error, "256", "slower than this program")
                break
        arrived = right.receive(count + 1, 0x155)
    assert [int.from_bytes(f.data, "little") for f in arrived] == list(range(count + 1))


def test_reserved_identifiers_are_those_of_one_client(daemon: Daemon) -> None:
    with channel(daemon, LEFT) as owner, channel(daemon, LEFT) as other:
        owner.can.claim(reserve=[0x180, (0x200, 0x27F), (0x18FF0000, 0x18FFFFFF)])
        other.can.claim()
        for identifier in (0x180, 0x210, 0x18FF0042):
            with pytest.raises(OwnedError) as error:
                other.can.send(identifier)
            names(error.value, f"0x{identifier:X}", "reserved", str(os.getpid()))
        other.can.send(0x181)
        other.can.send(0x210, extended=True)  # another identifier than that of 11 bits
        other.can.flush(PATIENCE)
        with pytest.raises(OwnedError):
            other.can.claim(reserve=[(0x270, 0x290)])
        other.can.send(0x181)  # a refused claim leaves it what it had
        shown = daemon.ctl_json("can", "stats", "left")["channels"][0]["senders"]
        assert ["180", "200-27F", "18FF0000-18FFFFFF"] in [one["reserved"] for one in shown]
        owner.can.release()
        other.can.claim(reserve=[(0x270, 0x290)])
        other.can.send(0x180)
        other.can.flush(PATIENCE)


def test_a_frame_that_no_library_writes_is_not_sent(daemon: Daemon) -> None:
    with channel(daemon, LEFT) as left, channel(daemon, RIGHT) as right:
        left.can.claim()
        before = left.can.info.refused
        left.can.send_all([frame(0x100), frame(0x101), frame(0x102)])
        left.can.flush(PATIENCE)
        slot = RawSlot(daemon.bus)
        queue = shm.struct("ecat_out_can_frame") * shm.CAN_QUEUE
        frames = queue.from_buffer(slot.memory, slot.at + slot.header.can_queues_offset)
        header = shm.struct("ecat_out_can").from_buffer(
            slot.memory, slot.at + slot.header.can_offset
        )
        for number, (word, length) in enumerate(
            [(0x20000001, 0), (0x100, 9), (0x800, 1), (0x103, 1)], header.written + 1
        ):
            frames[number % shm.CAN_QUEUE].id = word
            frames[number % shm.CAN_QUEUE].length = length
        header.written += 4
        slot.bell.can_seq += 1
        assert [f.identifier for f in right.receive(4)] == [0x100, 0x101, 0x102, 0x103]
        assert left.can.info.refused == before + 3
        header.written += 10_000  # more than a queue has
        slot.bell.can_seq += 1
        wait_for(lambda: "no client library writes" in daemon.log, daemon)
        del frames, header


# --- the end of senders -----------------------------------------------------------------------


def safe_frames(watcher: Channel, wanted: list[tuple[int, bytes]]) -> list[CanFrame]:
    """Frames until all of these were sent by the daemon."""
    return watcher.take(lambda seen: set(wanted) <= set(contents([f for f in seen if f.safe])))


@pytest.mark.parametrize("how", ["kill", "stop", "exit", "crash", "close"])
def test_safe_frames_are_sent_when_a_sender_is_gone(daemon: Daemon, how: str) -> None:
    """The frames that wait are dropped: no frame of a dead client comes after the safe ones."""
    endings = {"exit": "import os; os._exit(0)", "crash": "1 / 0", "close": "bus.close(); break"}
    ending = endings.get(how, "")
    with (
        channel(daemon, RIGHT) as right,
        channel(daemon, LEFT) as left,
        program(
            daemon,
            f"""
            can.send(0x201, b"go")
            can.flush({PATIENCE})
            print("ready", flush=True)
            while True:
                try:
                    can.send_all([frame(0x201, b"go")] * 64)
                except Exception:
                    {ending or "time.sleep(0.001)"}
            """,
        ) as process,
    ):
        wait_for_line(process)
        if how == "kill":
            process.kill()
        elif how == "stop":
            stop_process(process.pid)
        found = safe_frames(left, [NMT_STOP, NOTHING])
        first = next(i for i, f in enumerate(found) if f.safe)
        assert not [f for f in found[first:] if f.data == b"go"]
        right.take(lambda seen: NMT_STOP in contents(of_kind(seen, CanKind.RECEIVED)))
        again = left.take(lambda seen: len([f for f in seen if f.safe]) >= 3)
        assert {(f.identifier, f.data) for f in again if f.safe} == {
            NOTHING
        }  # the other is sent once
        if how == "stop":
            process.send_signal(signal.SIGCONT)
        left.can.claim()
        left.can.send(0x201, b"on")  # somebody sends it again, so the daemon no longer does
        left.can.flush(PATIENCE)
        wait_for(lambda: left.can.info.safe_active == 0, daemon)
        left.can.release()
    wait_for(lambda: "can_ended" in json.dumps(daemon.ctl_json("events")), daemon)


def test_a_process_that_was_stopped_learns_of_it(daemon: Daemon) -> None:
    with (
        program(
            daemon,
            """
        from ecatd.base.errors import LeaseError
        can.send(0x300)
        print("ready", flush=True)
        while True:
            time.sleep(0.01)
            try:
                can.send(0x300)
            except LeaseError as error:
                print(str(error).partition(":")[0], flush=True)
                can.claim()
                can.send(0x301)
                can.flush(10)
                print("again", flush=True)
                can.release()
                break
        """,
        ) as process,
        channel(daemon, LEFT) as left,
    ):
        wait_for_line(process)
        stop_process(process.pid)
        safe_frames(left, [NMT_STOP])
        process.send_signal(signal.SIGCONT)
        assert process.stdout is not None
        names(process.stdout.readline(), "no longer sends", "left")
        assert process.stdout.readline() == "again\n"


def test_a_sender_that_ends_in_order_has_sent_all_and_causes_only_what_it_should(
    daemon: Daemon,
) -> None:
    with channel(daemon, LEFT) as watcher, channel(daemon, RIGHT) as right:
        with channel(daemon, LEFT) as left:
            left.can.claim()
            left.can.flush(PATIENCE)
            for number in range(200):
                left.can.send(0x400, bytes([number]))
            left.can.flush(PATIENCE)
            left.can.release()
        assert [f.data[0] for f in right.receive(200, 0x400)] == list(range(200))
        watcher.take(lambda seen: len([f for f in seen if f.identifier == 0x400]) == 200)
        with channel(daemon, LEFT) as left:
            left.can.claim()
            left.can.send(0x202, b"x")
            left.can.flush(PATIENCE)
            left.can.release()
        found = safe_frames(watcher, [ENDED])
        assert contents([f for f in found if f.safe]) == [ENDED]


def test_a_lease_of_a_program_ends_when_it_sends_nothing(daemon: Daemon) -> None:
    with channel(daemon, LEFT) as left, channel(daemon, LEFT) as watcher:
        left.can.claim(lease=0.2)
        left.can.send(0x500)
        safe_frames(watcher, [NMT_STOP])
        with pytest.raises(LeaseError):
            left.can.send(0x500)
        left.can.claim()
        left.can.send(0x500)
        left.can.flush(PATIENCE)
        left.can.release()


def test_safe_frames_are_sent_before_the_daemon_ends(
    start_daemon: Callable[..., Daemon], rig: Path
) -> None:
    daemon = start_daemon(str(rig), config=CONFIG)
    with channel(daemon, LEFT) as left, channel(daemon, LEFT) as watcher:
        left.can.claim()
        left.can.send(0x201)
        left.can.flush(PATIENCE)
        daemon.process.terminate()
        seen: list[CanFrame] = []
        with pytest.raises(UnreachableError):
            while True:
                seen += watcher.can.read()
                watcher.client.wait()
        assert {NMT_STOP, NOTHING} <= set(contents([f for f in seen if f.safe]))
        assert daemon.process.wait(PATIENCE) == 0


def test_safe_frames_that_cannot_be_sent_are_told(
    start_daemon: Callable[..., Daemon], rig: Path
) -> None:
    config = CONFIG.replace("bus_off_restart_ms = 100", "bus_off_restart_ms = 0")
    daemon = start_daemon(str(rig), config=config)
    with channel(daemon, LEFT) as left:
        left.can.claim()
        left.can.send(0x201)
        left.can.flush(PATIENCE)
        simulator(daemon, "can-bus-off", str(LEFT))
        wait_for(lambda: left.can.info.state == CanState.BUS_OFF, daemon)
        daemon.process.terminate()
        assert daemon.process.wait(PATIENCE) == 0
    (line,) = [line for line in daemon.log.splitlines() if "safe frames were not sent" in line]
    names(line, "left", "bus-off")


def test_no_frame_goes_to_a_daemon_that_has_ended(
    start_daemon: Callable[..., Daemon], rig: Path
) -> None:
    daemon = start_daemon(str(rig), config=CONFIG)
    with channel(daemon, LEFT) as left:
        left.can.claim()
        left.can.send(0x100)
        left.can.flush(PATIENCE)
        daemon.kill_all()
        with pytest.raises(UnreachableError) as error:
            while True:  # BusyError would mean that its queue got full
                left.can.send(0x100)
                time.sleep(0.002)
        names(error.value, "has ended")


def test_frames_are_waited_for_while_the_cycle_stands_still(
    start_daemon: Callable[..., Daemon], rig: Path
) -> None:
    daemon = start_daemon(str(rig), config=CONFIG)
    with channel(daemon, LEFT) as left:
        left.can.claim()
        server = daemon.child_pid("ecatd.server")
        stop_process(server)
        try:
            with pytest.raises(UnreachableError, match="stands still"):
                while True:
                    Client.wait(left.client)
            left.can.send(0x100)
            with pytest.raises(NoAnswerError, match="did not come within"):
                left.can.flush(0.1)
        finally:
            os.kill(server, signal.SIGCONT)
        left.can.flush(PATIENCE)
        info = left.can.info
        assert info.own_sent + info.own_unsent == 1  # the slaves may have left OP meanwhile


# --- terminals that fail ----------------------------------------------------------------------


def numbered(
    left: Channel, right: Channel, until: Callable[[], bool]
) -> tuple[list[int], list[int]]:
    """Sends numbered frames until something has happened; what was confirmed, and what arrived."""
    sent = 0
    confirmed: list[int] = []
    arrived: list[int] = []
    end = time.monotonic() + PATIENCE
    while not until():
        assert time.monotonic() < end
        try:
            left.can.send(0x600, sent.to_bytes(4, "little"))
            sent += 1
        except BusyError:
            pass
        left.client.wait()
        confirmed += [
            int.from_bytes(f.data, "little")
            for f in of_kind(left.can.read(), CanKind.SENT)
            if f.identifier == 0x600
        ]
        arrived += [
            int.from_bytes(f.data, "little")
            for f in right.can.read()
            if f.kind == CanKind.RECEIVED and f.identifier == 0x600
        ]
    return confirmed, arrived


def test_a_terminal_that_lost_its_power_goes_on_and_doubles_nothing(
    start_daemon: Callable[..., Daemon], rig: Path
) -> None:
    daemon = start_daemon(str(rig), config=CONFIG)
    with channel(daemon, LEFT) as left, channel(daemon, RIGHT) as right:
        left.can.claim()
        restarts = left.can.info.restarts
        steps = iter(["power-off", "power-on", ""])
        step = next(steps)

        def until() -> bool:
            nonlocal step
            state = left.can.info.state
            if step == "power-off" and left.client.cycle % 100 == 0:
                simulator(daemon, "power-off", str(RIGHT))
                step = next(steps)
            elif step == "power-on" and right.can.info.state == CanState.STOPPED:
                simulator(daemon, "power-on", str(RIGHT))
                step = next(steps)
            return (
                step == ""
                and state == CanState.ACTIVE
                and right.can.info.state == CanState.ACTIVE
                and right.can.info.restarts > restarts
                and left.client.cycle % 500 == 0
            )

        confirmed, arrived = numbered(left, right, until)
        left.can.flush(PATIENCE)
        more = of_kind(right.can.read(), CanKind.RECEIVED)
        arrived += [int.from_bytes(f.data, "little") for f in more if f.identifier == 0x600]
    assert arrived == sorted(set(arrived)), "in order, and none twice"
    assert confirmed == sorted(set(confirmed))


def test_a_terminal_that_is_bus_off_is_started_anew(
    start_daemon: Callable[..., Daemon], rig: Path
) -> None:
    daemon = start_daemon(str(rig), config=CONFIG)
    with channel(daemon, LEFT) as left, channel(daemon, RIGHT) as right:
        left.can.claim()
        left.can.send(0x100)
        left.can.flush(PATIENCE)
        simulator(daemon, "can-bus-off", str(LEFT))
        states = left.take(
            lambda seen: CanState.BUS_OFF in [f.state[0] for f in of_kind(seen, CanKind.STATE)]
        )
        assert states
        wait_for(lambda: left.can.info.state == CanState.ACTIVE, daemon)
        left.can.send(0x101)
        left.can.flush(PATIENCE)
        assert 0x101 in [f.identifier for f in right.receive(2)]
        assert left.can.info.bus_offs == 1
    wait_for(lambda: "started anew" in daemon.log or "starts it anew" in daemon.log, daemon)
    kinds = [event["event"] for event in daemon.ctl_json("events")["events"]]
    assert "can_state" in kinds


def test_frames_on_a_bus_without_termination_are_sent_again(
    start_daemon: Callable[..., Daemon], rig: Path
) -> None:
    daemon = start_daemon(str(rig), config=CONFIG)
    with channel(daemon, LEFT) as left, channel(daemon, RIGHT) as right:
        left.can.claim()
        simulator(daemon, "can-noise", str(LEFT), "0.05")
        for number in range(100):
            left.can.send(0x100, bytes([number]))
        arrived = [f.data[0] for f in right.receive(100, 0x100)]
        assert arrived == list(range(100))


# --- ecatctl ----------------------------------------------------------------------------------


def test_ecatctl_sends_and_shows_frames_as_candump_does(daemon: Daemon) -> None:
    dump = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "ecatd.cli",
            "can",
            "dump",
            "left",
            "--count",
            "4",
            "123-124",
            "18FF0001",
        ],
        env=daemon.env,
        stdout=subprocess.PIPE,
        text=True,
    )
    with channel(daemon, RIGHT) as right:
        right.can.claim()
        while dump.poll() is None:  # until it listens
            right.can.send(0x123, b"\x5a")
            right.client.wait(20)
            daemon.ctl("can", "send", "left", "124#DEADBEEF", "18FF0001#R4", "700#")
        right.can.release()
    assert dump.stdout is not None
    lines = dump.stdout.read().splitlines()
    dump.stdout.close()
    name = f"{daemon.bus}/{LEFT}"
    known = {
        f"  {name}  RX - -       123   [1]  5A",
        f"  {name}  TX - -       124   [4]  DE AD BE EF",
        f"  {name}  TX - -  18FF0001   [4]  remote request",
    }
    assert len(lines) == 4
    assert set(lines) <= known


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ecatctl_that_sends_again_and_again_ends_in_order(daemon: Daemon, number: int) -> None:
    with channel(daemon, LEFT) as watcher:
        before = watcher.can.info.safe
        command = [sys.executable, "-m", "ecatd.cli", "can", "send", "left", "321#01"]
        with subprocess.Popen([*command, "--every", "0.01"], env=daemon.env) as process:
            try:
                watcher.take(lambda seen: len([f for f in seen if f.identifier == 0x321]) > 3)
                process.send_signal(number)
                assert process.wait(PATIENCE) == 0
            finally:
                process.kill()
        assert (watcher.can.info.safe, watcher.can.info.safe_active) == (before, 0)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["send", "left", "12G#00"], ["12G#00", "605#"]),
        (["send", "left", "123#0"], ["123#0"]),
        (["send", "left"], ["no frame"]),
        (["send", "9", "123#"], ["'9'", "left", "right"]),
        (["dump", "left", "xyz"], ["xyz", "181"]),
        (["stats", "9"], ["'9'", "left"]),
        (["send", "123#"], ["'123#'", "left", "right"]),
        (["dump"], ["which", "left", "right"]),
    ],
)
def test_wrong_arguments_are_explained(
    daemon: Daemon, arguments: list[str], words: list[str]
) -> None:
    result = daemon.ctl("can", *arguments, check=False)
    assert result.returncode == 2, result
    names(result.stderr, *words)


def test_config_check_warns_as_a_start_does(daemon: Daemon, tmp_path: Path) -> None:
    file = tmp_path / "long.toml"
    rest = "frames_per_second = 1000\nreceive_queue = 30\n"
    file.write_text(CONFIG.replace(rest, "layout = 'esd-c2922'\n", 1))
    warnings = daemon.ctl_json("config", "check", str(file))["warnings"]
    (queues,) = [text for text in warnings if "frames_per_second" in text]
    names(queues, "right", "bit_rate")
    (layout,) = [text for text in warnings if "leave layout out" in text]
    names(layout, "right", "EL6751")


def test_a_long_start_up_parameter_that_differs_is_shown_by_its_place(
    daemon: Daemon, tmp_path: Path
) -> None:
    file = tmp_path / "filters.toml"
    file.write_text(CONFIG.replace("bit_rate = 500\n", "bit_rate = 500\nfilters = [0x100]\n", 1))
    shown = daemon.ctl("startup", "verify", "left", "--config", str(file), check=False).stdout
    (line,) = [line for line in shown.splitlines() if "0x8001:00" in line]
    names(line, "different: first in byte 3")
    assert max(map(len, shown.splitlines())) < 160


def test_counters_arrive_everywhere(daemon: Daemon) -> None:
    with channel(daemon, LEFT) as left:
        left.can.claim()
        left.can.send(0x100)
        left.can.flush(PATIENCE)
        shown = daemon.ctl("can", "stats").stdout
        sent = left.can.info.sent
    assert re.search(rf"\b{sent} sent\b", shown)
    rows = daemon.ctl_json("stats")["channels"]
    assert [row["slave"] for row in rows] == [LEFT, RIGHT]
    assert rows[0]["sent"] >= sent
    assert rows[0]["can_state"] == "active"


def test_a_bus_without_another_node_is_a_fault_of_the_health(
    start_daemon: Callable[..., Daemon], rig: Path
) -> None:
    daemon = start_daemon(str(rig), config=CONFIG)
    assert daemon.ctl("check").returncode == 0
    simulator(daemon, "power-off", str(RIGHT))  # nobody acknowledges frames any more
    with channel(daemon, LEFT) as left:
        left.can.claim()
        left.can.send(0x100)
        wait_for(lambda: left.can.info.state == CanState.PASSIVE, daemon)
        shown = daemon.ctl("check", check=False).stdout
        (line,) = [line for line in shown.splitlines() if "error passive" in line]
        names(line, "left", "128", "termination")
        simulator(daemon, "power-on", str(RIGHT))
        left.can.flush(PATIENCE)
        assert left.can.info.own_sent == 1
