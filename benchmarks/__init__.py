"""Benchmarks of ecatd and ecatsim: `make bench`, or `python -m benchmarks --help`.

A folder for each: `benchmark.py` has `measure(bench, ...)`, which returns what was measured as data
for JSON, and what is different in a trial and when there is an hour (`SETTINGS`);
`section.md.j2` has what the page says about it: text, tables, targets and a figure.
"""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "tools"))  # sample buses
