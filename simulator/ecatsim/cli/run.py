"""`ecatsim run`: simulates a rig, alone or together with a command."""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from types import FrameType

from ecatd.base import network_namespace as namespace
from ecatd.base.errors import NotPermittedError, UsageError
from ecatd.base.process import OF_A_SEGMENT, die_with_parent, drop_rights

from ..control.server import Server
from ..control.sockets import FOLDER_VARIABLE, NAME_VARIABLE, folder
from ..files import python_file
from ..net import netlink
from ..replay import Replay
from ..rig import Rig
from ..rigs import library as rigs
from ..simulation import STEP_TIMES_US, Simulation
from .options import Parser
from .remarks import add_strict, tell, tell_left_out

SIMULATOR_END = "ecat-sim"
MASTER_END = "ecat-master"
SECOND = "2"  # suffix of both names for the other end of a ring
_CHILD_GRACE = 2.0
_MAX_DESCRIPTOR = 2**31 - 1


def add_arguments(parser: Parser, command: str) -> None:
    """Adds the arguments of the command to its parser."""
    del command
    parser.description = "Simulate a rig until you press Ctrl-C, or until COMMAND ends."
    parser.epilog = (
        "Without --interface, ecatsim makes a network namespace, and COMMAND runs in it. There, "
        f"a master reaches the segment on the interface {MASTER_END}, and the other end of a ring "
        f"on {MASTER_END}{SECOND}. The exit status is that of COMMAND."
    )
    parser.add_argument(
        "rig", metavar="RIG", help="name of a rig (see `ecatsim rigs`), or a file in TOML or Python"
    )
    parser.add_argument(
        "--interface", metavar="IF", help="answer on this interface, which exists already"
    )
    parser.add_argument("--ring", action="store_true", help="close a ring with a second interface")
    parser.add_argument("--second", metavar="IF", help="with --interface: the other end of a ring")
    parser.add_argument(
        "--trace", metavar="FILE", type=Path, help="record the plant in this CSV file"
    )
    parser.add_argument(
        "--replay",
        metavar="FILE",
        type=Path,
        help="play a recording (`ecatctl record --raw`) into the inputs",
    )
    parser.add_argument(
        "--repeat", action="store_true", help="with --replay: play it again and again"
    )
    parser.add_argument(
        "--step-time-us",
        metavar="US",
        type=int,
        default=STEP_TIMES_US.start,
        help="time between two steps of devices and plants (default and minimum: %(default)s)",
    )
    parser.add_argument(
        "--name", metavar="NAME", help="name for `ecatsim ctl --name` (default: its process id)"
    )
    parser.add_argument(
        "--ready-fd",
        metavar="N",
        type=int,
        help="when the segment answers, or in case of an error, write a line of JSON to this "
        "file descriptor",
    )
    parser.add_argument(
        "--die-with-parent", action="store_true", help="end when the calling process ends"
    )
    add_strict(parser)
    parser.add_argument(
        "child",
        metavar="-- COMMAND",
        nargs="*",
        default=[],
        help="command to run while the simulation runs",
    )
    parser.set_defaults(execute=_run)


def _run(options: argparse.Namespace) -> int:
    try:
        return _Runner(options).run()
    except Exception as error:
        ready_fd = options.ready_fd
        if ready_fd is not None and (reply := python_file.reply(error)):
            with suppress(OSError, ValueError), os.fdopen(ready_fd, "w") as ready:
                ready.write(json.dumps({"error": reply}) + "\n")
        raise


class _Runner:
    """One run of `ecatsim run`."""

    def __init__(self, arguments: argparse.Namespace) -> None:
        self._arguments = arguments
        self._signal = 0
        self._child: subprocess.Popen[bytes] | None = None
        self._deadline: float | None = None
        self._user_namespace = False
        self._server: Server | None = None

    def run(self) -> int:
        """Simulates the rig and returns the exit status."""
        arguments = self._arguments
        if arguments.ready_fd is not None and not 0 <= arguments.ready_fd <= _MAX_DESCRIPTOR:
            raise UsageError(f"--ready-fd {arguments.ready_fd} is not a file descriptor")
        if arguments.step_time_us not in STEP_TIMES_US:
            least, most = STEP_TIMES_US[0], STEP_TIMES_US[-1]
            raise UsageError(
                f"--step-time-us {arguments.step_time_us} must be from {least} to {most}"
            )
        if arguments.interface is None and arguments.second is None:
            self._enter_namespace()
        if not arguments.child:  # a command may need them
            drop_rights(OF_A_SEGMENT)  # before the files of the rig are read: they may be programs
        rig = rigs.make(arguments.rig)
        tell(rig, arguments.rig, strict=arguments.strict)
        rig.ring = rig.ring or arguments.ring or arguments.second is not None
        if arguments.replay is not None:
            replay = Replay(arguments.replay, rig, repeat=arguments.repeat)
            tell_left_out(arguments.replay, replay.left_out)
            if replay.damage:
                print(f"ecatsim: warning: {replay.damage}", file=sys.stderr)
        self._check_interfaces(rig.ring)
        parent = os.getppid()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, self._on_signal)
        simulation = Simulation(rig, arguments.trace, arguments.step_time_us)
        try:
            self._listen(simulation)
            interfaces = self._open_interfaces(rig.ring)
            if arguments.die_with_parent:
                die_with_parent(parent)
            simulation.segment.start(*interfaces)
            self._announce(rig)
            if arguments.child:
                self._start_child()
            simulation.run(self._finished)
            return self._status()
        finally:
            if self._child and self._child.poll() is None:
                self._child.kill()
                self._child.wait()
            if self._server:
                self._server.close()
            simulation.close()

    def _enter_namespace(self) -> None:
        """Enters a network namespace of its own.

        This happens before the rig is made, since numerical libraries start threads, and a process
        with threads cannot enter a user namespace. The directory of the sockets is determined
        before that, since every user is root in a user namespace.
        """
        os.environ[FOLDER_VARIABLE] = str(folder().absolute())
        self._user_namespace = namespace.enter_new()

    def _listen(self, simulation: Simulation) -> None:
        """Opens the control socket. Without `--name`, the simulator also runs if that fails."""
        name = self._arguments.name
        try:
            self._server = Server(
                simulation,
                name,
                self._arguments.interface or MASTER_END,
                lambda: self._on_signal(signal.SIGTERM, None),
            )
        except NotPermittedError as error:
            if name is not None:
                raise
            print(f"ecatsim: `ecatsim ctl` cannot control this run: {error}", file=sys.stderr)
        else:
            simulation.after_step.append(self._server.serve)

    def _check_interfaces(self, ring: bool) -> None:
        first, second = self._arguments.interface, self._arguments.second
        if second is not None and first is None:
            raise UsageError("--second needs --interface IF for the first end of the ring")
        if ring and first is not None and second is None:
            raise UsageError(f"the rig is a ring: --interface {first} needs --second IF beside it")
        if first is not None and first == second:
            raise UsageError("--interface and --second are the same: a ring has two ends")

    def _open_interfaces(self, ring: bool) -> list[str]:
        """Creates the private interfaces, or checks the given ones."""
        given = [self._arguments.interface, self._arguments.second]
        interfaces = [name for name in given if name is not None]
        for name in interfaces:
            netlink.check_up(name)
        if interfaces:
            return interfaces
        ends = ("", SECOND) if ring else ("",)
        for end in ends:
            netlink.create_veth(SIMULATOR_END + end, MASTER_END + end)
        return [SIMULATOR_END + end for end in ends]

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        del frame
        self._signal = number

    def _finished(self) -> bool:
        """Whether to stop: after a signal, or as soon as the command has ended.

        If there is a command, it gets a moment to end after a signal.
        """
        child = self._child
        if child is None or child.poll() is not None:
            return child is not None or self._signal != 0
        if self._signal == 0:
            return False
        now = time.monotonic()
        if self._deadline is None:
            self._deadline = now + _CHILD_GRACE
            if self._signal != signal.SIGINT:  # Ctrl-C has reached the command, too
                child.terminate()
        return now > self._deadline

    def _status(self) -> int:
        if self._child is None:
            return 0
        if self._child.poll() is None:
            self._child.kill()
        status = self._child.wait()
        return status if status >= 0 else 128 - status

    def _announce(self, rig: Rig) -> None:
        arguments = self._arguments
        interface = arguments.interface or MASTER_END
        facts = {
            "pid": os.getpid(),
            "interface": interface,
            "rig": rig.name,
            "slaves": len(rig.devices),
            "warnings": rig.remarks,
            "name": self._server.name if self._server else None,
        }
        where = f"on {interface}"
        if rig.ring:
            facts["second"] = arguments.second or MASTER_END + SECOND
            where = f"in a ring between {interface} and {facts['second']}"
        if arguments.ready_fd is not None:
            try:
                with os.fdopen(arguments.ready_fd, "w") as ready:
                    ready.write(json.dumps(facts) + "\n")
                arguments.ready_fd = None  # it is closed, so its number may be another file's
            except OSError as error:
                raise UsageError(f"--ready-fd {arguments.ready_fd}: {error.strerror}") from error
        elif not arguments.child:
            print(f"rig {rig.name}: {rig.size} {where}")
            if arguments.interface is None:
                user = "--preserve-credentials -U " if self._user_namespace else ""
                print(f"run a master beside it with: nsenter {user}-n -t {os.getpid()} COMMAND")
            if self._server:
                print(f"control it with: ecatsim ctl --name {self._server.name} COMMAND")
            print("Ctrl-C ends it", flush=True)

    def _start_child(self) -> None:
        command, parent = self._arguments.child, os.getpid()
        environment = dict(os.environ)
        if self._server:
            environment[FOLDER_VARIABLE] = str(self._server.path.parent.absolute())
            environment[NAME_VARIABLE] = self._server.name
        try:
            self._child = subprocess.Popen(
                command,
                env=environment,
                preexec_fn=lambda: die_with_parent(parent, signal.SIGKILL),
            )
        except OSError as error:
            raise UsageError(f"cannot run '{command[0]}': {error.strerror}") from error
