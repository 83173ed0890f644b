"""Command `can`: frames of the CAN buses behind terminals, in the format of candump and cansend."""

from __future__ import annotations

import argparse
import re
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from ecatd.base.errors import BusyError, NoAnswerError, UnreachableError, UsageError
from ecatd.base.timeouts import Timeout

from .arguments import add_watch, seconds, times
from .output import print_json_line, table_lines
from .signals import ended_by_signals, noted_signals, open_client
from .terminal import check_stdout
from .watch import present

if TYPE_CHECKING:
    from ecatd.client import Client
    from ecatd.client.can import CanChannel, CanFrame
    from ecatd.shm.can import CanChannelContents

COMMANDS = {"values": {"can": "Show, send and count frames of CAN buses behind terminals."}}

_ACTIONS = ("dump", "send", "bridge", "stats")
_FRAME = re.compile(r"([0-9A-Fa-f]{1,8})#(?:[Rr]([0-8]?)|([0-9A-Fa-f._ ]*))")
_FILTER = re.compile(r"([0-9A-Fa-f]{1,8})(?:-([0-9A-Fa-f]{1,8}))?")
_WAIT = 5.0
"""Seconds that `can send` waits until its frames were sent."""
_LOOK = 0.1
"""Seconds after which it looks whether it shall end."""


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments."""
    command.add_argument("action", choices=_ACTIONS, metavar="ACTION", help=", ".join(_ACTIONS))
    command.add_argument(
        "words",
        nargs="*",
        metavar="ARGUMENT",
        help="[SLAVE] and what follows. For send: frames such as 605#4000100000000000, 18FF0001#01 "
        "(8 digits: 29 bits), 123#R (remote) or 123#R4. For dump: the identifiers that are shown, "
        "such as 181 or 200-27F. For bridge: SLAVE and a CAN interface of Linux, such as vcan0. "
        "SLAVE: the terminal, by position or name, if there are several",
    )
    command.add_argument(
        "-L", "--log", action="store_true", help="for dump: lines of a log file, as `candump -L`"
    )
    command.add_argument(
        "--count", type=times, metavar="N", help="for dump, and for stats --watch: stop after N"
    )
    command.add_argument(
        "--for", dest="seconds", type=seconds, metavar="S", help="for dump: stop after S seconds"
    )
    command.add_argument(
        "--every", type=seconds, metavar="S", help="for send: send again every S seconds"
    )
    add_watch(command, count=False)


def can(options: argparse.Namespace) -> None:
    """Carries out an action."""
    if options.action == "stats":
        _stats(options)
        return
    with ended_by_signals(), open_client(options) as client:
        channel, words = _channel(client, list(options.words))
        if options.action == "bridge":
            _bridge(options, channel.info.slave, words)
        elif options.action == "dump":
            _dump(options, channel, words)
        else:
            _send(options, channel, words)


def _channel(client: Client, words: list[str]) -> tuple[CanChannel, list[str]]:
    """The channel that the first word names, and the other words."""
    there = client.can_terminals()
    if not there:
        raise UsageError(
            f"bus '{client.name}' has no CAN terminal: add [slave.can] to the [[slave]] table of "
            "one in the configuration of ecatd"
        )
    slaves = client.slaves()
    names = {slaves[position].name: position for position in there}
    if words and (words[0] in names or (words[0].isdecimal() and int(words[0]) in there)):
        first = words.pop(0)
        return client.can(names[first] if first in names else int(first)), words
    if len(there) == 1 and (not words or _FRAME.fullmatch(words[0]) or _FILTER.fullmatch(words[0])):
        return client.can(there[0]), words
    known = ", ".join(f"{position} ({slaves[position].name})" for position in there)
    if not words:
        raise UsageError(f"which CAN terminal? There are {known}: name one")
    raise UsageError(f"'{words[0]}' is no CAN terminal: there are {known}")


# --- dump -------------------------------------------------------------------------------------


def _dump(options: argparse.Namespace, channel: CanChannel, words: list[str]) -> None:
    wanted = [_filter(word) for word in words]
    name = f"{options.bus}/{channel.info.slave}"
    check_stdout()
    left, end = options.count, None
    if options.seconds is not None:
        end = time.monotonic() + options.seconds
    for frame in _frames(channel, end):
        if not _is_wanted(frame, wanted):
            continue
        if options.json:
            print_json_line({"bus": options.bus, **_document(frame)})
        else:
            print(_line(frame, name, log=options.log), flush=True)
        if left is not None:
            left -= 1
            if left == 0:
                return


def _frames(channel: CanChannel, end: float | None) -> Iterator[CanFrame]:
    """Frames and other records, without end or until a time."""
    missed = 0
    while True:
        left = 1.0 if end is None else min(1.0, end - time.monotonic())
        if left <= 0:
            return
        try:
            channel.wait(left)
        except NoAnswerError:
            continue
        except UnreachableError:
            time.sleep(0.1)
            continue
        yield from channel.read()
        if channel.info.missed != missed:
            missed = channel.info.missed
            import sys

            print(f"ecatctl: {missed} frames were missed so far", file=sys.stderr, flush=True)


def _filter(word: str) -> tuple[int, int]:
    match = _FILTER.fullmatch(word)
    if match is None:
        raise UsageError(f"'{word}' is no identifier such as 181, nor a range such as 200-27F")
    first = int(match[1], 16)
    last = first if match[2] is None else int(match[2], 16)
    if first > last:
        raise UsageError(f"'{word}': the first identifier is greater than the last")
    return first, last


def _is_wanted(frame: CanFrame, wanted: list[tuple[int, int]]) -> bool:
    from ecatd.shm.contract import CanKind

    if frame.kind not in (CanKind.RECEIVED, CanKind.SENT):
        return True
    return not wanted or any(first <= frame.identifier <= last for first, last in wanted)


def _identifier(frame: CanFrame) -> str:
    return f"{frame.identifier:0{8 if frame.extended else 3}X}"


def _line(frame: CanFrame, name: str, *, log: bool) -> str:
    """A line as `candump -x` writes it; records that are no frames follow as comments."""
    from ecatd.client.can import wall_clock
    from ecatd.shm.contract import CanKind

    if frame.kind not in (CanKind.RECEIVED, CanKind.SENT):
        return f"# {_news(frame)}"
    if log:
        data = f"R{frame.length or ''}" if frame.remote else frame.data.hex().upper()
        side = "R" if frame.kind == CanKind.RECEIVED else "T"
        return f"({wall_clock(frame.time_ns):.6f}) {name} {_identifier(frame)}#{data} {side}"
    data = "remote request" if frame.remote else frame.data.hex(" ").upper()
    side = {CanKind.RECEIVED: "RX", CanKind.SENT: "TX"}[frame.kind]
    return f"  {name}  {side} - -  {_identifier(frame):>8}   [{frame.length}]  {data}".rstrip()


def _news(frame: CanFrame) -> str:
    from ecatd.shm.contract import CanKind

    if frame.kind == CanKind.STATE:
        state, sending, receiving = frame.state
        word = state.name.lower().replace("_", "-")
        return (
            f"the CAN controller is {word}; error counters {sending} (sent), {receiving} (received)"
        )
    if frame.kind == CanKind.OVERFLOW:
        return "the terminal has lost frames that it received"
    return f"{_identifier(frame)}: the terminal has lost this frame; it may have been sent"


def _document(frame: CanFrame) -> dict[str, Any]:
    from ecatd.client.can import wall_clock
    from ecatd.shm.contract import CanKind

    made: dict[str, Any] = {
        "time": round(wall_clock(frame.time_ns), 6),
        "cycle": frame.cycle,
        "kind": frame.kind.name.lower(),
    }
    if frame.kind == CanKind.STATE:
        state, sending, receiving = frame.state
        return made | {
            "state": state.name.lower(),
            "send_errors": sending,
            "receive_errors": receiving,
        }
    if frame.kind == CanKind.OVERFLOW:
        return made
    return made | {
        "id": frame.identifier,
        "extended": frame.extended,
        "remote": frame.remote,
        "length": frame.length,
        "data": frame.data.hex(),
        "safe": frame.safe,
    }


# --- send -------------------------------------------------------------------------------------


def _send(options: argparse.Namespace, channel: CanChannel, words: list[str]) -> None:
    frames = [parse_frame(word) for word in words]
    if not frames:
        raise UsageError("no frame to send: write one such as 605#4000100000000000")
    channel.claim()
    with noted_signals() as is_over:  # the end of the command is no crash of a sender
        while True:
            for frame in frames:
                _put(channel, frame)
            channel.flush(_WAIT)
            info = channel.info
            if info.own_refused or info.own_unsent:
                raise NoAnswerError(
                    f"{info.own_refused} frames were refused, and {info.own_unsent} were lost by "
                    "the terminal: `ecatctl can stats` and `ecatctl events` say why"
                )
            if options.every is None or is_over():
                break
            _sleep(options.every, is_over)
            if is_over():
                break
        channel.release()


def _sleep(seconds: float, is_over: Callable[[], bool]) -> None:
    end = time.monotonic() + seconds
    while not is_over() and (left := end - time.monotonic()) > 0:
        time.sleep(min(left, _LOOK))


def _put(channel: CanChannel, frame: CanFrame) -> None:
    """Puts a frame into the queue as soon as there is room."""
    patience = Timeout(_WAIT)
    end = time.monotonic() + _WAIT
    while True:
        try:
            channel.send_all([frame])
        except BusyError as error:
            if time.monotonic() > end:
                raise BusyError(f"{error}; there was no room for {patience}") from error
            time.sleep(0.002)
        else:
            return


def parse_frame(word: str) -> CanFrame:
    """A frame as cansend reads it: `123#DEADBEEF`, `12345678#`, `123#R4`.

    Raises:
        UsageError: It is none.
    """
    from ecatd.client.can import frame

    match = _FRAME.fullmatch(word)
    digits = re.sub(r"[._ ]", "", match[3] or "") if match else ""
    if match is None or len(digits) % 2:
        raise UsageError(
            f"'{word}' is no CAN frame: write identifier#data in hexadecimal digits, such as "
            "605#4000100000000000, or identifier#R for a remote frame"
        )
    remote = "#R" in word.upper()
    extended = len(match[1]) > 3
    length = int(match[2] or 0) if remote else None
    return frame(int(match[1], 16), bytes.fromhex(digits), extended, remote, length)


# --- bridge -----------------------------------------------------------------------------------


def _bridge(options: argparse.Namespace, slave: int, words: list[str]) -> None:
    import sys

    from .can_bridge import Bridge, is_virtual, open_interface

    if len(words) != 1:
        raise UsageError("can bridge takes one CAN interface of Linux, such as vcan0")
    (name,) = words

    def tell(text: str) -> None:
        print(f"ecatctl: {text}", file=sys.stderr, flush=True)

    with noted_signals() as is_over, open_interface(name) as there:
        bridge = Bridge(options.bus, slave, there, name, is_virtual(name), tell)
        print(f"{options.bus}/{slave} and {name} have each other's frames", flush=True)
        bridge.run(is_over)


# --- stats ------------------------------------------------------------------------------------


def _stats(options: argparse.Namespace) -> None:
    if options.connect is not None:
        raise UsageError("can stats reads shared memory, which only the machine of the daemon has")
    if len(options.words) > 1:
        raise UsageError(f"can stats takes one SLAVE, not {len(options.words)}")

    def take() -> dict[str, Any]:
        from ecatd.shm.can import read_can

        found = read_can(options.bus)
        chosen = [item for item in found if _is_chosen(item, options.words)]
        if options.words and not chosen:
            there = ", ".join(f"{item.slave} ({item.name})" for item in found) or "none"
            raise UsageError(f"'{options.words[0]}' is no CAN terminal: there are {there}")
        return {"bus": options.bus, "channels": [_channel_document(item) for item in chosen]}

    present(options, take, _lines)


def _is_chosen(item: CanChannelContents, words: list[str]) -> bool:
    return not words or words[0] in (str(item.slave), item.name)


def _channel_document(item: CanChannelContents) -> dict[str, Any]:
    return {
        "slave": item.slave,
        "slave_name": item.name,
        "bit_rate": item.bit_rate,
        "identifier_bits": item.identifier_bits,
        "receive_queue": item.receive_queue,
        "send_queue": item.send_queue,
        "state": item.state.name.lower(),
        "send_errors": item.send_errors,
        "receive_errors": item.receive_errors,
        "safe_active": item.safe_active,
        **item.counters,
        "senders": [
            {
                "slot": one.slot,
                "program": one.program,
                "pid": one.pid,
                "waiting": one.waiting,
                "sent": one.sent,
                "refused": one.refused,
                "unsent": one.unsent,
                "reserved": [_range_text(*pair) for pair in one.ranges],
            }
            for one in item.senders
        ],
    }


def _range_text(first: int, last: int) -> str:
    from ecatd.shm.contract import CAN_EXTENDED, CAN_ID

    digits = 8 if first & CAN_EXTENDED else 3
    ends = [f"{end & CAN_ID:0{digits}X}" for end in (first, last)]
    return ends[0] if first == last else "-".join(ends)


def _lines(document: dict[str, Any]) -> list[str]:
    if not document["channels"]:
        return ["no CAN terminal: [slave.can] in the configuration of ecatd makes a slave one"]
    lines: list[str] = []
    for item in document["channels"]:
        lines += [*_channel_lines(item), ""]
    return lines[:-1]


def _channel_lines(item: dict[str, Any]) -> Iterator[str]:
    """A channel, what is not well with it, and its senders."""
    from ecatd.shm.contract import CAN_COUNTERS

    from .terminal import alarm

    state = item["state"].replace("_", "-")
    yield (
        f"slave {item['slave']} ({item['slave_name']}): {item['bit_rate'] / 1000:g} kbit/s, "
        f"identifiers of {item['identifier_bits']} bits, {state}"
    )
    yield (
        f"  error counters {item['send_errors']} (sent), {item['receive_errors']} (received); "
        f"queues {item['send_queue']} and {item['receive_queue']} frames"
    )
    yield f"  {item['received']} frames received, {item['sent']} sent"
    for counter in CAN_COUNTERS:
        if counter.severity != "info" and item[counter.name]:
            line = f"  {item[counter.name]} {counter.label}: {counter.meaning}"
            yield alarm(line) if counter.severity == "warning" else line
    if item["safe_active"]:
        number = item["safe_active"]
        what = "safe frame is" if number == 1 else "safe frames are"
        yield alarm(f"  {number} {what} being sent: a sender has ended")
    if item["senders"]:
        table = table_lines(
            ("SENDER", "PID", "WAITING", "SENT", "REFUSED", "LOST", "RESERVED"),
            (
                (
                    one["program"] or f"slot {one['slot']}",
                    one["pid"] or "?",
                    "?" if one["waiting"] is None else one["waiting"],
                    one["sent"],
                    one["refused"],
                    one["unsent"],
                    ", ".join(one["reserved"]),
                )
                for one in item["senders"]
            ),
            " >>>>>",
        )
        yield from (f"  {line}" for line in table)
