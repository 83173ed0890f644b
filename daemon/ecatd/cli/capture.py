"""Command `capture`: the last frames on the wire, as a file for Wireshark."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from ecatd.base.errors import EcatError, StateError, UsageError
from ecatd.base.files import open_new
from ecatd.base.pcapng import Frame, header, packet, read_records
from ecatd.operations.frames import RINGS, ReadFrames

from .arguments import seconds
from .output import print_json
from .saving import add_force, check_target, writing
from .signals import noted_signals
from .terminal import check_stdout

if TYPE_CHECKING:
    from ecatd.client.remote import Remote

COMMANDS = {"machine": {"capture": "Write the last frames on the wire to a file, for Wireshark."}}

_PAUSE = 0.2
"""Seconds between two looks for new frames."""
_AT_ONCE = 64
"""Frames that are written together."""


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments."""
    command.add_argument(
        *("-o", "--output"),
        metavar="FILE",
        required=True,
        help="file to write, in the pcapng format; - for stdout",
    )
    add_force(command)
    command.add_argument(
        "--last", type=seconds, metavar="S", help="only the frames of the last S seconds"
    )
    command.add_argument(
        "--follow", action="store_true", help="keep writing new frames until you press Ctrl-C"
    )
    command.add_argument(
        "--duration", type=seconds, metavar="S", help="with --follow: stop after S seconds"
    )


class Source:
    """The frames that a daemon keeps, in the order of time.

    Attributes:
        interfaces: Names of the interfaces, by port.
        clock_ns: Unix time minus the time of the frames.
        missing: Bytes that were overwritten before they were read.
    """

    def __init__(self, remote: Remote) -> None:
        self._remote = remote
        self._positions = dict.fromkeys(RINGS, 0)
        self._waiting: list[Frame] = []
        self.interfaces: list[str] = []
        self.clock_ns = 0
        self.missing = 0

    def read(self) -> list[Frame]:
        """Returns the frames since the last call. Those that may be out of order wait."""
        complete_ns = min([self._read(ring) for ring in RINGS])
        self._waiting.sort(key=lambda frame: frame.time_ns)
        count = sum(frame.time_ns < complete_ns for frame in self._waiting)
        ready, self._waiting = self._waiting[:count], self._waiting[count:]
        return ready

    def _read(self, ring: str) -> int:
        """Reads the frames in a ring; returns the time up to which no frame is missing."""
        while True:
            before = self._positions[ring]
            answer = self._remote.request(ReadFrames(ring, before))
            self.interfaces, self.clock_ns = answer["interfaces"], answer["clock_ns"]
            self._waiting.extend(read_records(answer["records"]))
            self._positions[ring] = answer["position"]
            if before:  # frames from before the first look do not count as missing
                self.missing += max(answer["overwritten"], 0)
            if not answer["more"]:
                return int(answer["now_ns"])


def capture(remote: Remote, options: argparse.Namespace) -> None:
    """Writes frames to a file."""
    if options.duration and not options.follow:
        raise UsageError("--duration needs --follow")
    if options.json and options.output == "-":
        raise UsageError("the frames go to stdout: give --output FILE with --json")
    if options.output != "-":
        check_target(Path(options.output), force=options.force)
    source = Source(remote)
    first, last, ended = 0, 0, False
    frames = source.read()
    if options.last and frames:
        begin = frames[-1].time_ns - int(options.last * 1e9)
        frames = [frame for frame in frames if frame.time_ns >= begin]
    deadline = time.monotonic() + (options.duration or float("inf"))
    with _File(options.output, force=options.force) as file, noted_signals() as is_ended:
        file.begin(source.interfaces)
        while True:
            file.add(frames, source.clock_ns)
            if frames:
                first, last = first or frames[0].time_ns, frames[-1].time_ns
            if not options.follow or ended:
                break
            time.sleep(_PAUSE)
            # The frames until now belong to the file.
            ended = is_ended() or time.monotonic() >= deadline
            try:
                frames = source.read()
            except EcatError:  # the daemon ends, for example
                kept = f"{options.output} keeps the {file.frames} frames until then"
                print(f"ecatctl: {kept}", file=sys.stderr)
                raise
    span = (last - first) / 1e9
    if options.json:
        found = {"file": options.output, "frames": file.frames, "seconds": span}
        print_json({"bus": remote.bus, **found, "bytes_missing": source.missing})
        return
    text = f"{options.output}: {file.frames} frames in {span:.3f} s"
    if source.missing:
        text += f"; {source.missing} bytes were overwritten before they were read"
    print(text, file=sys.stderr)


class _File(ExitStack):
    """The file, or stdout.

    Attributes:
        frames: Number of frames that are in it.

    Raises:
        StateError: It cannot be written.
        UsageError: It is a terminal, or stdout is closed.
    """

    def __init__(self, path: str, *, force: bool) -> None:
        super().__init__()
        self.frames = 0
        self._path = path
        self._file: BinaryIO
        if path == "-":
            check_stdout()
            if sys.stdout.isatty():
                raise UsageError("a terminal cannot show frames: pipe them to `wireshark -k -i -`")
            self._file = sys.stdout.buffer
            return
        with writing(Path(path)):
            number = open_new(Path(path), force=force)
            # Not buffered: no block waits for room when the file is closed.
            self._file = self.enter_context(open(number, "wb", buffering=0))  # noqa: PTH123, SIM115
            if Path(path).is_file():
                self._file.truncate(0)

    def begin(self, interfaces: Sequence[str]) -> None:
        """Writes what is in front of all frames."""
        self._write(header(interfaces))

    def add(self, frames: Sequence[Frame], clock_ns: int) -> None:
        """Adds frames.

        Args:
            frames: The frames.
            clock_ns: Unix time minus the time of the frames.

        Raises:
            StateError: Not all can be written, for example because the disk is full. The file ends
                with the last whole block; it is removed if it has no frame.
        """
        for at in range(0, len(frames), _AT_ONCE):
            batch = frames[at : at + _AT_ONCE]
            self._write(b"".join(packet(frame, clock_ns) for frame in batch))
            self.frames += len(batch)

    def _write(self, blocks: bytes) -> None:
        written = 0
        try:
            while written < len(blocks):
                written += self._file.write(blocks[written:])
            self._file.flush()
        except OSError as error:
            if self._path == "-":  # the reader has gone, or the shell has opened a file
                raise
            with suppress(OSError):  # a pipe cannot be cut
                self._file.truncate(self._file.tell() - written)
            safe = f"{self.frames} frames are safe in it"
            if not self.frames and Path(self._path).is_file():
                Path(self._path).unlink()
                safe = "nothing was captured"
            raise StateError(f"{self._path} cannot be written: {error.strerror}; {safe}") from error
