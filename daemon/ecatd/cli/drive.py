"""Command `drive`: enables, homes, moves and jogs an axis, and shows what it does."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from ecatd.base.errors import StateError, UsageError

from .arguments import add_yes, confirm, seconds
from .output import print_json
from .signals import ended_by_signals, open_client

if TYPE_CHECKING:
    from ecatd.client.axis_status import AxisStatus
    from ecatd.client.drives import Drive, Drives

COMMANDS = {"values": {"drive": "Enable, home, move and jog an axis (CiA 402), or show its state."}}

_ACTIONS = ("status", "enable", "reset", "home", "move", "jog")
_LEASE = 0.5
"""Seconds after which the axis is safe if this command hangs or is stopped."""
_LOOK = 0.1
_KEYS = {"\033[C": 1, "\033[D": -1, "+": 1, "-": -1}
"""Right and left arrow, + and -."""


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments."""
    command.add_argument(
        "axis", metavar="AXIS", help="slave, by position or name; NAME/2 is its second axis"
    )
    command.add_argument("action", choices=_ACTIONS, metavar="ACTION", help=", ".join(_ACTIONS))
    command.add_argument(
        "position", nargs="?", type=float, metavar="POSITION", help="for move: rad, or m"
    )
    command.add_argument(
        "--by", action="store_true", help="for move: POSITION is a distance from where it is"
    )
    command.add_argument(
        "--speed",
        type=float,
        metavar="V",
        help="for move and jog: rad/s or m/s (default: 1 rad/s, 0.1 m/s)",
    )
    command.add_argument(
        "--acceleration",
        type=float,
        metavar="A",
        help="for move and jog: rad/s² or m/s² (default: 10, 1)",
    )
    command.add_argument(
        "--step",
        type=float,
        metavar="D",
        help="for jog: distance for each key (default: 0.1 rad, 0.01 m)",
    )
    command.add_argument(
        "--method", type=int, metavar="N", help="for home: homing method, object 0x6098"
    )
    command.add_argument(
        "--scale",
        type=float,
        metavar="U",
        help="rad or m for one increment, if the bus has no unit",
    )
    command.add_argument(
        "--within", type=seconds, metavar="S", help="for home and move: seconds that it may take"
    )
    add_yes(command)


def drive(options: argparse.Namespace) -> int:
    """Carries out an action."""
    if (options.position is None) == (options.action == "move"):
        raise UsageError(
            "move needs a POSITION" if options.action == "move" else "only move has a POSITION"
        )
    with open_client(options) as bus:
        name = int(options.axis) if options.axis.isdecimal() else options.axis
        axes = bus.drives(name, lease=_LEASE)
        axis = axes[0]
        if options.scale is not None:
            axis.units(position=options.scale)
        if options.action == "status":
            return _status(options, axes)
        _warn(options, axis)
        with ended_by_signals():
            try:
                with axis:
                    _RUN[options.action](options, axis)
            except KeyboardInterrupt:
                print(
                    f"\n{options.axis}: ended; the outputs take their safe values", file=sys.stderr
                )
                raise
    return 0


def _warn(options: argparse.Namespace, axis: Drive) -> None:
    unit = "m" if axis.linear else "rad"
    what = {
        "enable": "enables it where it stands, until Ctrl-C",
        "reset": "resets its fault",
        "home": "homes it: it moves until it has found its reference",
        "jog": f"moves it by {_step(options, axis):g} {unit} for each key",
        "move": f"moves it {'by' if options.by else 'to'} {options.position} {unit}",
    }[options.action]
    confirm(options, f"This takes over axis {options.axis} and {what}. Then its outputs are safe.")


# --- status -----------------------------------------------------------------------------------


def _status(options: argparse.Namespace, axes: Drives) -> int:
    axes.observe()
    try:
        status = axes[0].status
        _show(options, axes[0], status)
    finally:
        axes.close()
    return 0 if status.connected else StateError.exit_code


def _show(options: argparse.Namespace, axis: Drive, status: AxisStatus) -> None:
    from ecatd.client.axis_status import DriveMode

    if options.json:
        print_json({"bus": options.bus, "axis": options.axis, **_document(axis, status)})
        return
    unit = "m" if axis.linear else "rad"
    modes = {mode.value: mode.name.lower().replace("_", " ") for mode in DriveMode}
    print(axis.explain())
    print(f"  mode      {modes.get(status.mode, 'none')} ({status.mode})")
    print(f"  position  {status.position:.6g} {unit}")
    print(f"  speed     {status.speed:.6g} {unit}/s")
    print(f"  torque    {status.torque:.6g} {axis.torque_unit or 'rated'}")


def _document(axis: Drive, status: AxisStatus) -> dict[str, Any]:
    return {
        "slave": axis.slave,
        "state": status.state.name.lower(),
        "enabled": status.enabled,
        "connected": status.connected,
        "mode": status.mode,
        "status_word": status.status,
        "error_code": status.error,
        "unit": "m" if axis.linear else "rad",
        "position": status.position,
        "speed": status.speed,
        "torque": status.torque,
        "torque_unit": axis.torque_unit,
        "text": axis.explain(),
    }


# --- motion -----------------------------------------------------------------------------------


def _enable(options: argparse.Namespace, axis: Drive) -> None:
    axis.enable(5.0)
    print(f"{axis.explain()}; Ctrl-C ends it", flush=True)
    while True:
        time.sleep(_LOOK)
        axis.check()


def _reset(options: argparse.Namespace, axis: Drive) -> None:
    axis.reset(5.0)
    _show(options, axis, axis.status)


def _home(options: argparse.Namespace, axis: Drive) -> None:
    axis.enable()
    axis.home(options.method, options.within or 60.0)
    _show(options, axis, axis.status)


def _move(options: argparse.Namespace, axis: Drive) -> None:
    axis.enable()
    goal = options.position + (axis.position if options.by else 0.0)
    with _progress(options, axis):
        axis.move_to(
            goal, speed=options.speed, acceleration=options.acceleration, timeout=options.within
        )
    _show(options, axis, axis.status)


@contextmanager
def _progress(options: argparse.Namespace, axis: Drive) -> Iterator[None]:
    """Shows on a terminal where the axis is meanwhile."""
    import threading

    over = threading.Event()

    def show() -> None:
        while not over.wait(_LOOK):
            print(f"\r{axis.name}: {axis.position:10.4f}  ", end="", file=sys.stderr, flush=True)
        print("\r" + " " * 40 + "\r", end="", file=sys.stderr, flush=True)

    thread = threading.Thread(target=show)
    if sys.stderr.isatty() and not options.json:
        thread.start()
    try:
        yield
    finally:
        over.set()
        if thread.is_alive():
            thread.join()


def _step(options: argparse.Namespace, axis: Drive) -> float:
    usual = 0.01 if axis.linear else 0.1
    step = usual if options.step is None else options.step
    if not 0 < step < 1e6:
        raise UsageError(f"--step must be between 0 and 1e6, not {step:g}")
    return float(step)


def _jog(options: argparse.Namespace, axis: Drive) -> None:
    """Moves by a step for each key: a terminal tells no release of a key."""
    step = _step(options, axis)
    if not sys.stdin.isatty():
        raise UsageError("jog reads keys, so it needs a terminal")
    axis.enable(5.0)
    goal = axis.position
    print(f"{axis.name}: ← and → (or - and +) move it by {step:g}; q ends", flush=True)
    with _keys() as read:
        while (key := read()) not in ("q", "\x1b"):
            axis.check()
            if key in _KEYS:
                # A key that is held down must not pile up a way that goes on after its release.
                if abs(goal - axis.position) < 2 * step:
                    goal += _KEYS[key] * step
                axis.move_to(
                    goal, speed=options.speed, acceleration=options.acceleration, wait=False
                )
            print(f"\r{axis.name}: {axis.position:10.4f}  ", end="", flush=True)
    print()


@contextmanager
def _keys() -> Iterator[Any]:
    """A function that returns a key, or nothing after a while; the terminal shows no keys."""
    import os
    import select
    import termios
    import tty

    number = sys.stdin.fileno()
    before = termios.tcgetattr(number)

    def read() -> str:
        ready, _, _ = select.select([number], [], [], _LOOK)
        return os.read(number, 8).decode(errors="replace") if ready else ""

    tty.setcbreak(number)
    try:
        yield read
    finally:
        termios.tcsetattr(number, termios.TCSADRAIN, before)


_RUN = {"enable": _enable, "reset": _reset, "home": _home, "move": _move, "jog": _jog}
