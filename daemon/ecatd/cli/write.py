"""Command `write`: keeps values at outputs, by names."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterable
from typing import TYPE_CHECKING

from ecatd.base.errors import LeaseError, UsageError
from ecatd.client.outputs_in_op import check_in_op
from ecatd.client.patterns import find_output

from .arguments import add_yes, confirm
from .output import print_json
from .signals import add_for, ended_by_signals, is_physical, open_client

if TYPE_CHECKING:
    from ecatd.client import Client
    from ecatd.client.signals import Signal

COMMANDS = {"values": {"write": "Hold outputs, chosen by name, at given values."}}

_LEASE = 1.0
"""Seconds after which outputs are safe if this command hangs or is killed."""
_BEAT = 0.1
"""Seconds between two signs of life."""


def add_arguments(command: argparse.ArgumentParser, _name: str) -> None:
    """Adds the arguments of the command."""
    command.add_argument(
        "values",
        nargs="+",
        metavar="NAME=VALUE",
        help="an output and the value in its unit, such as 'drive/Target velocity=5'",
    )
    command.add_argument("--raw", action="store_true", help="give raw values, without units")
    add_for(command, "release the outputs after S seconds (default: when you press Ctrl-C)")
    add_yes(command)


def write(options: argparse.Namespace) -> None:
    """Becomes the owner of outputs, and keeps values there until it ends."""
    with open_client(options) as client:
        wanted: dict[Signal, float] = {}
        for text in options.values:
            output, value = _assigned(client, text, raw=options.raw)
            if output in wanted:
                raise UsageError(f"{output.path} is given twice")
            wanted[output] = value
        check_in_op(client, wanted)
        slaves = {client.slaves()[output.slave].name: None for output in wanted}
        texts = [f"{output.path} = {value}" for output, value in wanted.items()]
        about = f"This takes over {', '.join(texts)} ({', '.join(slaves)})"
        until = "until Ctrl-C" if options.seconds is None else f"for {options.seconds:g} s"
        confirm(options, f"{about} {until}. Then the outputs take their safe values.")
        with ended_by_signals(), client.claim(wanted, lease=_LEASE):
            for output, value in wanted.items():
                if options.raw or not is_physical(output):
                    output.raw = value
                else:
                    output.value = value
            client.commit()
            _hold(client, wanted, options.seconds)
        rows = [{"output": output.path, "value": value} for output, value in wanted.items()]
        if options.json:
            print_json({"bus": client.name, "written": rows})
        else:
            print("the outputs are released, and have their safe values again")


def _assigned(client: Client, text: str, *, raw: bool) -> tuple[Signal, float]:
    """The output and the value of an argument; whole numbers keep all their digits.

    Raises:
        UsageError: It is not an output with a value.
        StateError: There is no such entry.
    """
    name, equals, value = text.rpartition("=")
    number: float = 0
    try:
        number = int(value, 0)
    except ValueError:
        try:
            number = float(value)
        except ValueError:
            equals = ""
    if not equals or not name:
        raise UsageError(
            f"'{text}' is not an output with a value such as 'drive/Target velocity=5'"
        )
    output = find_output(client, name)
    whole = not output.real and (raw or not is_physical(output))
    if whole and isinstance(number, float):
        if not number.is_integer():
            raise UsageError(f"{output.path} takes whole numbers, not {number:g}")
        number = int(number)
    return output, number


def _hold(client: Client, wanted: Iterable[Signal], duration: float | None) -> None:
    """Gives signs of life until the time is over, or the user ends the command.

    Raises:
        LeaseError: The outputs were lost.
        StateError: A slave has left OP.
    """
    outputs = list(wanted)
    end = None if duration is None else time.monotonic() + duration
    try:
        while end is None or time.monotonic() < end:
            time.sleep(_BEAT if end is None else min(_BEAT, max(0.0, end - time.monotonic())))
            client.sample()
            lost = [output.path for output in outputs if not client.output(output).owned]
            if lost:
                raise LeaseError(
                    f"{', '.join(lost)}: lost, and at the safe value, because this command gave no "
                    "sign of life in time; write again"
                )
            check_in_op(client, outputs)
    except KeyboardInterrupt:
        return
