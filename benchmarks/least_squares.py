"""Straight lines through measured points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


def fit(points: Sequence[dict[str, Any]], keys: Sequence[str], value: str) -> list[float]:
    """The constant, and the slope of each key, of `value`; each point counts relatively."""
    rows = [[1.0, *(float(point[key]) for key in keys)] for point in points]
    # By its relative error: the large ones must not drown the small ones.
    weights = [1.0 / point[value] for point in points]
    return _solve(rows, [point[value] for point in points], weights)


def _solve(
    rows: Sequence[Sequence[float]], values: Sequence[float], weights: Sequence[float]
) -> list[float]:
    """Weighted normal equations by Gaussian elimination."""
    size = len(rows[0])
    scaled = [
        ([w * x for x in row], w * y) for row, y, w in zip(rows, values, weights, strict=True)
    ]
    matrix = [
        [sum(row[i] * row[k] for row, _ in scaled) for k in range(size)]
        + [sum(row[i] * y for row, y in scaled)]
        for i in range(size)
    ]
    for i in range(size):
        pivot = max(range(i, size), key=lambda k: abs(matrix[k][i]))
        matrix[i], matrix[pivot] = matrix[pivot], matrix[i]
        matrix[i] = [x / matrix[i][i] for x in matrix[i]]
        for k in range(size):
            if k != i:
                matrix[k] = [
                    x - matrix[k][i] * y for x, y in zip(matrix[k], matrix[i], strict=True)
                ]
    return [round(row[size], 3) for row in matrix]
