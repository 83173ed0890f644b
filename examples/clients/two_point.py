"""Switches an output by the level of an input, in every cycle, and looks after a slave beside it.

    python two_point.py 4/0x6000:11 3/0x7000:01 --on 5000 --off -5000

The output is on from when the level is above --on until it is below --off; it is at its safe value
while the level is not valid. Each second a line is printed, with the error register of a slave
(object 0x1001), which is read while the control goes on. A lost lease and a daemon that was started
again are told, and it goes on. Ctrl-C ends it; the output then goes to its safe value.
"""

from __future__ import annotations

import argparse
import asyncio
import sys

from ecatd import Client, EcatError, LeaseError, NoAnswerError, Signal, UnreachableError, Validity

PASSING = (LeaseError, NoAnswerError, UnreachableError)
"""What ends by itself, or with a new claim."""


async def control(bus: Client, level: Signal, switch: Signal, on: float, off: float) -> None:
    """The control: as long as it owns the output."""
    state = False
    with bus.claim(switch, lease=0.1):
        async for _cycle in bus.cycles():
            if level.validity is not Validity.VALID:
                raise NoAnswerError(f"{level.path} is {level.validity.name}")
            state = level.value > (off if state else on)
            switch.raw = state
            bus.commit()


async def keep_controlling(
    bus: Client, level: Signal, switch: Signal, on: float, off: float
) -> None:
    """The control, again and again."""
    while True:
        try:
            await control(bus, level, switch, on, off)
        except PASSING as error:
            print(f"two_point: {error}", file=sys.stderr)
        await asyncio.sleep(0.5)


async def look_after(bus: Client, level: Signal, switch: Signal, slave: int) -> None:
    """A line a second."""
    while True:
        try:
            errors = (await bus.sdo_upload(slave, 0x1001)).hex()
        except EcatError as error:
            errors = str(error)
        print(f"{level.value:g} {level.unit} {switch.raw} {errors}", flush=True)
        await asyncio.sleep(1)


async def run(options: argparse.Namespace) -> None:
    """Both tasks, until the time is over or one of them fails."""
    with Client(options.bus) as bus:
        level, switch = bus.signal(options.level), bus.signal(options.switch)
        tasks = asyncio.gather(
            keep_controlling(bus, level, switch, options.on, options.off),
            look_after(bus, level, switch, options.slave),
        )
        try:
            async with asyncio.timeout(options.seconds):
                await tasks
        except TimeoutError:
            pass


def main() -> int:
    """The program; returns its exit status."""
    parser = argparse.ArgumentParser(description="Switches an output by the level of an input.")
    parser.add_argument("--bus", default="ecat0", help="name of the bus (default: ecat0)")
    parser.add_argument("--on", type=float, required=True, help="level above which it is on")
    parser.add_argument("--off", type=float, required=True, help="level below which it is off")
    parser.add_argument("--slave", type=int, default=0, help="slave to look after (default: 0)")
    parser.add_argument("--seconds", type=float, help="ends after so long")
    parser.add_argument("level", help="the input: 'slave/entry', as `ecatctl pdos` shows it")
    parser.add_argument("switch", help="the output")
    try:
        asyncio.run(run(parser.parse_args()))
    except EcatError as error:
        print(f"two_point: {error}", file=sys.stderr)
        return error.exit_code
    except (KeyboardInterrupt, BrokenPipeError):
        pass
    return 0


if __name__ == "__main__":
    sys.exit(main())
