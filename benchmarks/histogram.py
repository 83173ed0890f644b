"""Histograms with the buckets of the engine, for all programs: 32 buckets per octave."""

from __future__ import annotations

import ctypes
from collections import Counter
from collections.abc import Iterable
from typing import Any

from ecatd.shm import contract as shm

Buckets = Counter[int]
"""Number of samples in each bucket, by number of the bucket."""

_LIB = shm.LIBRARY
_LIB.ecat_histogram_bucket.restype = ctypes.c_uint
_LIB.ecat_histogram_bucket.argtypes = [ctypes.c_uint64]
_LIB.ecat_histogram_bound.restype = ctypes.c_uint64
_LIB.ecat_histogram_bound.argtypes = [ctypes.c_uint]


def of_samples(samples: Iterable[int]) -> Buckets:
    """Returns the histogram of times in nanoseconds."""
    return Buckets(map(_LIB.ecat_histogram_bucket, samples))


def of_shared(histogram: Any) -> Buckets:
    """Returns the histogram in an `ecat_shm_histogram`."""
    return Buckets({i: n for i, n in enumerate(histogram.buckets) if n})


def of_pairs(pairs: Iterable[tuple[int, int]]) -> Buckets:
    """Returns the histogram that `pairs` has turned into pairs."""
    return Buckets(dict(pairs))


def pairs(buckets: Buckets) -> list[tuple[int, int]]:
    """Returns pairs of bucket and number of samples, sorted, for JSON."""
    return sorted(buckets.items())


def quantile(buckets: Buckets, q: float) -> float:
    """Returns the time in nanoseconds below which the share `q` of the samples lies.

    Samples are assumed to be evenly spread within a bucket, which is 3 % wide.
    """
    rank = q * sum(buckets.values())
    for bucket, count in sorted(buckets.items()):
        if rank <= count:
            low, high = (_LIB.ecat_histogram_bound(bucket + i) for i in (0, 1))
            return float(low + (high - low) * rank / count)
        rank -= count
    return 0.0
