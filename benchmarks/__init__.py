"""Benchmarks of ecatd and ecatsim: `make bench`, or `python -m benchmarks --help`.

A folder for each: `benchmark.py` has settings for a trial, for minutes and for an hour (`SETTINGS`)
and `measure(settings, say)`, which returns what was measured as data for JSON; `section.md.j2` has
what the page says about it: text, tables, targets and a figure.
"""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "tools"))  # sample buses
