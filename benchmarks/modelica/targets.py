"""What models are meant to reach, and whether they do."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ..target import Target
from ..words import slaves, us

GENERATION_S = 1.0
"""Most that the command may take for a library of 200 slaves."""
SHARE = 0.05
"""Most of a sample time of 1 ms that a sample may take: the rest is the model's."""
_SAMPLE_TIME_NS = 1e6


def targets(result: dict[str, Any]) -> Iterator[Target]:
    """All of them, in the order of the page."""
    generation = result["generation"]
    yield Target(
        f"generation of a library of {slaves(generation['slaves'])}",
        f"≤ {GENERATION_S:g} s",
        f"{generation['seconds']:.2f} s",
        generation["seconds"] <= GENERATION_S,
    )
    for case in result["samples"]:
        yield Target(
            f"a sample of {slaves(case['slaves'])}, of 1 ms",
            f"≤ {SHARE:.0%}",
            f"{case['model'] / _SAMPLE_TIME_NS:.1%} ({us(case['model'])} µs, {case['ratio']:.2f} × "
            f"plain calls)",
            case["model"] <= SHARE * _SAMPLE_TIME_NS,
        )
