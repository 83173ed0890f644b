"""Sums, ratios and fits of many measurements."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Sequence
from typing import Any


def fit(
    points: Sequence[dict[str, Any]], keys: Sequence[str], value: str, names: Sequence[str]
) -> dict[str, float]:
    """Fits `value` as a linear function of `keys`.

    The fit minimises relative errors, so that large points do not outweigh small ones.

    Args:
        points: The measured points.
        keys: Keys of the independent variables in a point.
        value: Key of the measured value in a point.
        names: Names for the constant and for the slope of each key.

    Returns:
        The constant and the slopes, by name.
    """
    # Imported here because numpy starts threads: such a process cannot enter a user namespace.
    import numpy as np

    weights = np.array([1.0 / point[value] for point in points])
    rows = np.array([[1.0, *(float(point[key]) for key in keys)] for point in points])
    found = np.linalg.lstsq(rows * weights[:, None], np.ones(len(points)), rcond=None)[0]
    return {name: round(float(x), 3) for name, x in zip(names, found, strict=True)}


def ratio(name: str, ours: Iterable[float], theirs: Iterable[float]) -> dict[str, Any]:
    """Returns the median of the ratios of corresponding values, as `name`, and their quartiles."""
    ratios = sorted(mine / other for mine, other in zip(ours, theirs, strict=True))
    quarter = len(ratios) // 4
    return {
        name: round(statistics.median(ratios), 4),
        f"{name}_quartiles": [round(ratios[quarter], 4), round(ratios[-1 - quarter], 4)],
    }


def total(items: Iterable[dict[str, Any]], *keys: str) -> dict[str, Any]:
    """Returns the sum over all items for each of the keys that the first item has."""
    found = list(items)
    return {key: sum(item[key] for item in found) for key in keys if key in found[0]}
