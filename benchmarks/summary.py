"""What many measurements say together."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Sequence
from typing import Any


def fit(
    points: Sequence[dict[str, Any]], keys: Sequence[str], value: str, names: Sequence[str]
) -> dict[str, float]:
    """The straight line of `value` through points: the constant, and the slope of each key.

    Args:
        points: Measured; each counts by its relative error, so that the large do not drown the
            small.
        keys: What `value` depends on.
        value: What was measured.
        names: Of the constant and of the slopes.
    """
    # Not above: numpy starts threads, and a process with threads cannot enter a user namespace.
    import numpy as np

    weights = np.array([1.0 / point[value] for point in points])
    rows = np.array([[1.0, *(float(point[key]) for key in keys)] for point in points])
    found = np.linalg.lstsq(rows * weights[:, None], np.ones(len(points)), rcond=None)[0]
    return {name: round(float(x), 3) for name, x in zip(names, found, strict=True)}


def ratio(name: str, ours: Iterable[float], theirs: Iterable[float]) -> dict[str, Any]:
    """The median of the ratios of neighbours, and their quartiles, under `name`."""
    ratios = sorted(mine / other for mine, other in zip(ours, theirs, strict=True))
    quarter = len(ratios) // 4
    return {
        name: round(statistics.median(ratios), 4),
        f"{name}_quartiles": [round(ratios[quarter], 4), round(ratios[-1 - quarter], 4)],
    }


def total(items: Iterable[dict[str, Any]], *keys: str) -> dict[str, Any]:
    """The sums of these keys, where they are there."""
    found = list(items)
    return {key: sum(item[key] for item in found) for key in keys if key in found[0]}
