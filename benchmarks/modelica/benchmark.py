"""A sample of a model with many slaves, beside the same work by plain calls; a large library.

The engine of the daemon exchanges with simulated slaves at 1 kHz meanwhile. The blocks are those of
a generated library, through the functions that make the calls of the blocks in their order; where
OpenModelica is on PATH, also through a model that it has translated.
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
    """Everything.

    Args:
        bench: Where.
        slaves: Numbers of slaves.
        seconds: How long each is measured.
        translated: Numbers of slaves of models that OpenModelica translates, if it is there.
        rounds: How often a library is generated.
    """
    bench.say("generation of a library of 200 slaves")
    return {
        "generation": generation.measure(bench.folder, rounds),
        "samples": [sample.measure(bench, count, seconds) for count in slaves],
        "translated": sample.translated(bench, translated),
    }
