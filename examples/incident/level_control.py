"""Keeps the level of a tank: a pump runs from when the level is low until it is high again.

    python level_control.py                      on the bus, until Ctrl-C
    python level_control.py --against tank.csv   with the values of an incident, without a bus

The level is channel 5 of slave 5, in V: 1 V is 1 m. The pump is channel 1 of slave 3. Each line
says when the pump was switched. `docs/yesterday.md` finds what is wrong with it, and mends it: with
`--lowest 0` it does not believe a level below 0 V, which a tank cannot have.
"""

from __future__ import annotations

import argparse
import csv
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from ecatd import Client, EcatError, UnreachableError, Validity

LEVEL, PUMP = "5/0x6040:11", "3/0x7000:01"
LOW, HIGH = 0.5, 0.8  # V


class LevelControl:
    """The model: what the pump should do, cycle by cycle.

    Args:
        lowest: A level below this is that of a broken sensor; then the pump does not run.
    """

    def __init__(self, lowest: float | None = None) -> None:
        self._lowest = lowest
        self.pump = False

    def step(self, level: float, valid: bool) -> bool:
        """Returns whether the pump runs in this cycle."""
        if not valid or (self._lowest is not None and level < self._lowest):
            self.pump = False
        elif self.pump:
            self.pump = level < HIGH
        else:
            self.pump = level < LOW
        return self.pump


def cycles_of(path: str) -> Iterator[tuple[float, float, bool]]:
    """Yields time, level and validity of each cycle of a table of `ecatctl incident export`."""
    with Path(path).open(newline="") as file:
        for row in csv.DictReader(file):
            yield float(row["time"]), float(row["level"]), row["el3008_2.valid"] == "1"


def run_against(control: LevelControl, path: str) -> int:
    """Runs the model with recorded values; returns how often it switches the pump on."""
    count, before = 0, False
    for at, level, valid in cycles_of(path):
        now = control.step(level, valid)
        if now != before:
            print(f"{at:.3f} s: pump {'on' if now else 'off'} at {level:.2f} V", flush=True)
            count += now
        before = now
    return count


def connect(bus: str) -> Client:
    """Connects to a bus, and waits for it as long as that takes."""
    while True:
        try:
            return Client(bus)
        except UnreachableError:
            time.sleep(0.05)


def run_on_bus(control: LevelControl, bus: str, seconds: float | None) -> int:
    """Runs the model on the bus; returns how often it switches the pump on."""
    count = 0
    with connect(bus) as client:
        level, pump = client.signal(LEVEL), client.signal(PUMP)
        begin = time.monotonic()
        with client.claim(pump, lease=0.5):
            while seconds is None or time.monotonic() - begin < seconds:
                client.wait()
                client.sample()
                before = control.pump
                pump.raw = control.step(level.value, level.validity is Validity.VALID)
                client.commit()
                if control.pump != before:
                    at, what = time.monotonic() - begin, "on" if control.pump else "off"
                    print(f"{at:.3f} s: pump {what} at {level.value:.2f} V", flush=True)
                    count += control.pump
    return count


def main() -> int:
    """The program; returns its exit status."""
    parser = argparse.ArgumentParser(description="Keeps the level of a tank.")
    parser.add_argument("--bus", default=os.environ.get("ECATD_BUS", "ecat0"))
    parser.add_argument("--seconds", type=float, help="ends after so long")
    parser.add_argument("--against", metavar="CSV", help="use these values, and no bus")
    parser.add_argument("--lowest", type=float, help="lowest level in V that can be true")
    options = parser.parse_args()
    control = LevelControl(options.lowest)
    try:
        if options.against:
            count = run_against(control, options.against)
        else:
            count = run_on_bus(control, options.bus, options.seconds)
    except EcatError as error:
        print(f"level_control: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return 0
    print(f"the pump was switched on {count} times" if count else "the pump has not run")
    return 0


if __name__ == "__main__":
    sys.exit(main())
