"""A sample of a model with many slaves, compared with plain calls; and a large library.

Meanwhile the engine of the daemon exchanges with simulated slaves at 1 kHz. The blocks come from a
generated library. A C program calls the library's functions, which make the calls of the blocks in
their order. If OpenModelica is on PATH, a model that it has translated is measured, too.
"""

from __future__ import annotations

from typing import Any

from ..bench import Bench
from . import generation, sample

SETTINGS: dict[str, dict[str, Any]] = {
    "quick": {"seconds": 0.05, "translated": (), "rounds": 1},
    "full": {"seconds": 10.0, "rounds": 15},
}


def measure(
    bench: Bench,
    *,
    slaves: tuple[int, ...] = (8, 64, 200),
    seconds: float = 2.0,
    translated: tuple[int, ...] = (8, 64, 200),
    rounds: int = 5,
) -> dict[str, Any]:
    """Runs the whole benchmark and returns its results.

    Args:
        bench: Folder and processors for the measurement.
        slaves: Numbers of slaves.
        seconds: How long each number of slaves is measured.
        translated: Numbers of slaves of the models that OpenModelica translates, if it is there.
        rounds: How often the library is generated.
    """
    bench.say("generation of a library of 200 slaves")
    return {
        "generation": generation.measure(bench.folder, rounds),
        "samples": [sample.measure(bench, count, seconds) for count in slaves],
        "translated": sample.translated(bench, translated),
    }
