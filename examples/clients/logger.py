"""Writes signals of a bus to a CSV file, a line each cycle or every so many.

    python logger.py --every 10 "0/Velocity actual value" 4/0x6000:11 > log.csv

Only reads, so it can be started beside whatever drives the bus, and as often as you like. Values
are physical; a cell is empty where the value is not valid. Goes on when the daemon was started
again. Ctrl-C ends it.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time

from ecatd import Client, EcatError, NoAnswerError, Signal, UnreachableError, Validity


def header(signals: list[Signal]) -> list[str]:
    """Titles of the columns, with units where the signals have them."""
    titles = [s.path + (f" [{s.unit}]" if s.unit else "") for s in signals]
    return ["time_s", "cycle", *titles]


def row(bus: Client, signals: list[Signal]) -> list[object]:
    """One line: CLOCK_MONOTONIC of the cycle, its number, and the values."""
    domain = bus.domain(signals[0].domain)
    values = [s.value if s.validity is Validity.VALID else "" for s in signals]
    return [f"{domain.time_ns / 1e9:.6f}", domain.cycle, *values]


def log(bus: Client, signals: list[Signal], every: int, seconds: float) -> None:
    """Writes lines until the time is over."""
    out = csv.writer(sys.stdout)
    out.writerow(header(signals))
    end = time.monotonic() + seconds
    complained = False
    while time.monotonic() < end:
        try:
            bus.wait(every, timeout=1.0)
            bus.sample()
        except (UnreachableError, NoAnswerError) as error:
            if not complained:
                print(f"logger: {error}", file=sys.stderr)
            complained = True
            continue
        complained = False
        out.writerow(row(bus, signals))


def main() -> int:
    """The program; returns its exit status."""
    parser = argparse.ArgumentParser(description="Writes signals of a bus to stdout as CSV.")
    parser.add_argument("--bus", default="ecat0", help="name of the bus (default: ecat0)")
    parser.add_argument("--every", type=int, default=1, help="a line every so many cycles")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="ends after so long")
    parser.add_argument("signal", nargs="+", help="'slave/entry', as `ecatctl pdos` shows them")
    options = parser.parse_args()
    try:
        with Client(options.bus) as bus:
            log(bus, [bus.signal(name) for name in options.signal], options.every, options.seconds)
    except EcatError as error:
        print(f"logger: {error}", file=sys.stderr)
        return error.exit_code
    except (KeyboardInterrupt, BrokenPipeError):
        pass
    return 0


if __name__ == "__main__":
    sys.exit(main())
