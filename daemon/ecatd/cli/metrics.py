"""Command `metrics`: prints the statistics for Prometheus and programs like it (OpenMetrics)."""

from __future__ import annotations

import argparse

from ecatd.base.errors import EcatError, UsageError
from ecatd.operations.health import Health
from ecatd.shm.statistics.open_metrics import write_metrics

from .source import Source

COMMANDS = {
    "health": {"metrics": "Print the statistics for Prometheus, in the OpenMetrics format."}
}


def metrics(options: argparse.Namespace) -> None:
    """Prints the metrics; those of single slaves only if the gateway answers."""
    if options.json:
        raise UsageError(
            "metrics have a format of their own; `ecatctl stats --json` gives the statistics as "
            "JSON"
        )
    with Source(options) as source:
        snapshot = source.read()
        slaves: Health | EcatError
        try:
            slaves = source.remote().health()
        except EcatError as error:
            slaves = error
    print(write_metrics(snapshot, slaves), end="")
