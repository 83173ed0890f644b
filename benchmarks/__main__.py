"""Runs the benchmarks: `python -m benchmarks --out FOLDER`."""

from __future__ import annotations

import argparse
import json
import re
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from ecatd.base.errors import EcatError, UsageError

from . import interruptions, machine, report
from .bench import prepared
from .report import SECTIONS


def main() -> int:
    """Measures, and writes FOLDER/performance.md and FOLDER/performance/.

    Returns:
        The exit status.
    """
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("bench"), help="folder for the results")
    length = parser.add_mutually_exclusive_group()
    length.add_argument("--quick", action="store_true", help="a trial of seconds, not minutes")
    length.add_argument("--full", action="store_true", help="measure more and longer: an hour")
    parser.add_argument("--only", choices=SECTIONS, help="only this one; keep other results")
    parser.add_argument("--report-only", action="store_true", help="only write the page")
    options = parser.parse_args()
    folder = options.out / "performance"
    extent = "quick" if options.quick else "full" if options.full else "normal"
    try:
        if not options.report_only:
            _prepare(folder)
            facts = machine.describe()  # before a benchmark enters a network namespace
            facts["interruptions"] = interruptions.measure(extent)
            for name in [options.only] if options.only else SECTIONS:
                if what := _missing(name):
                    print(f"  {name} is left out: it needs {what}", file=sys.stderr, flush=True)
                    continue
                (folder / f"{name}.json").write_text(_as_json(_measure(name, extent, facts)))
        print(report.write(options.out))
        return 0
    except EcatError as error:
        print(f"benchmarks: {error}", file=sys.stderr)
        return error.exit_code


def _missing(name: str) -> str:
    """Returns what a benchmark needs that is not there, or nothing."""
    module = import_module(f".{name}.benchmark", __package__)
    return str(module.missing()) if hasattr(module, "missing") else ""


def _measure(name: str, extent: str, facts: dict[str, Any]) -> dict[str, Any]:
    """Runs one benchmark and returns its result, with `facts` about the machine."""
    module = import_module(f".{name}.benchmark", __package__)
    with prepared(lambda text: print(f"  {text} ...", file=sys.stderr, flush=True)) as bench:
        found = module.measure(bench, **module.SETTINGS.get(extent, {}))
    return {
        "schema": 1,
        "benchmark": name,
        "extent": extent,
        "machine": facts,
        **found,
    }


def _as_json(result: dict[str, Any]) -> str:
    """Returns JSON that is easy to read and compare: one item or list of numbers per line."""
    text = json.dumps(result, indent=1)
    return re.sub(r"\[[\s\d.,eE+-]+\]", lambda match: " ".join(match[0].split()), text) + "\n"


def _prepare(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"cannot write to '{folder}': {error.strerror}") from error


if __name__ == "__main__":
    sys.exit(main())
