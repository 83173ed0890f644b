"""Benchmarks of ecatd and ecatsim: `make bench`, or `python -m benchmarks --help`.

A benchmark is a module with settings for a trial, for minutes and for an hour (`SETTINGS`) and
`measure(settings, say)`, which returns what was measured as data for JSON; and a report with
`section(result)`, which says it in Markdown, and `plot(result, path)`, which draws it.
"""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "tools"))  # sample buses
