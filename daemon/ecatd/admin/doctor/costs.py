"""What settings of `[realtime]` cost, as measured on our test machine."""

from __future__ import annotations

from typing import NamedTuple


class Cost(NamedTuple):
    """What a setting costs on our test machine, compared with a better one.

    Attributes:
        row: The settings: a row of the section "Real-time settings" of docs/performance.md.
        better: The settings of the better row.
        load: `alone`, or `busy`: with a busy program on each processor.
        exchange_us: The 99th percentile of the exchange in µs, in both rows.
        missed: How many of 1000 cycles were missed, in both rows.
    """

    row: str
    better: str
    load: str
    exchange_us: tuple[float, float]
    missed: tuple[float, float]

    def __str__(self) -> str:
        worse, better = self.exchange_us
        where = " while other programs were busy" if self.load == "busy" else ""
        text = (
            f"on our test machine, the exchange took {worse:g} µs instead of {better:g} µs{where} "
            "(99th percentile)"
        )
        worse, better = self.missed
        if worse >= 2 * better and worse >= 1:
            text += f", and missed {worse:g} of 1000 cycles instead of {better:g}"
        return text


_DEFAULTS = "the defaults"  # with a processor that is not isolated
_SLEEPS = "`dma_latency_us = -1`"

COSTS = {
    "priority": Cost("`priority = 0`", _DEFAULTS, "busy", (75.7, 41.9), (7.27, 1.0)),
    "cpu": Cost(_DEFAULTS, "`cpu` not set", "busy", (41.9, 15.0), (1.0, 0.0)),
    "poll_us": Cost("`poll_us = 0`", _DEFAULTS, "alone", (33.9, 16.4), (0.44, 0.78)),
    "dma_latency_us": Cost(_SLEEPS, _DEFAULTS, "alone", (108.3, 16.4), (0.89, 0.78)),
}
"""The costs, by the key of `[realtime]`."""
