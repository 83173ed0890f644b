"""Benchmarks of ecatd and ecatsim: `make bench`, or `python -m benchmarks --help`.

Each benchmark has a folder with two files. `benchmark.py` has `measure(bench, ...)`, which returns
the results as data for JSON, and `SETTINGS`, the arguments of `measure` for `--quick` and `--full`.
`section.md.j2` is the section of the page: text, tables, targets and a figure.
"""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "tools"))  # sample buses
