"""Runs the benchmarks: `python -m benchmarks --out FOLDER`."""

from __future__ import annotations

import argparse
import json
import re
import sys
from pathlib import Path
from typing import Any

from ecatd.model.errors import EcatError, UsageError

from . import machine, report, simulator

BENCHMARKS = {simulator.NAME: simulator}


def main() -> int:
    """Measures, writes FOLDER/performance.md and FOLDER/performance/; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("bench"), help="folder for the results")
    parser.add_argument("--quick", action="store_true", help="seconds instead of minutes: a trial")
    parser.add_argument("--report-only", action="store_true", help="write the page again")
    options = parser.parse_args()
    folder = options.out / "performance"
    try:
        if not options.report_only:
            _prepare(folder)
            result = {
                "schema": 1,
                "benchmark": simulator.NAME,
                "machine": machine.describe(),
                **simulator.measure(
                    simulator.QUICK if options.quick else simulator.Settings(),
                    lambda text: print(f"  {text} ...", file=sys.stderr, flush=True),
                ),
            }
            (folder / f"{simulator.NAME}.json").write_text(_as_json(result))
        print(report.write(options.out))
        return 0
    except EcatError as error:
        print(f"benchmarks: {error}", file=sys.stderr)
        return error.exit_code


def _as_json(result: dict[str, Any]) -> str:
    """JSON that can be read and compared: an item a line, but lists of numbers in one."""
    text = json.dumps(result, indent=1)
    return re.sub(r"\[[\s\d.,eE+-]+\]", lambda match: " ".join(match[0].split()), text) + "\n"


def _prepare(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"cannot write to '{folder}': {error.strerror}") from error


if __name__ == "__main__":
    sys.exit(main())
