"""Statistics as text in the OpenMetrics format 1.0, for Prometheus and programs like it.

Counters are those since the start of the exchange; times are in seconds.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from ecatd.base.errors import EcatError
from ecatd.base.sanitized_output import printable
from ecatd.description.bus import display_name
from ecatd.description.cables import BAD, GOOD, STRAINED, UNKNOWN
from ecatd.etg.al import AlState
from ecatd.operations.faults import EXCHANGE
from ecatd.operations.health import Health, required

from .. import contract as shm
from .problems import find_problems, is_exchanged
from .snapshot import Histogram, Snapshot

CONTENT_TYPE = "application/openmetrics-text; version=1.0.0; charset=utf-8"

_BOUNDS_NS = tuple(step * 10**power for power in range(3, 9) for step in (1, 2, 5))
"""Upper bounds of the steps of all histograms: 1 µs to 0.5 s."""
_VERDICTS = {GOOD: 0, STRAINED: 1, BAD: 2, UNKNOWN: -1}


def write_metrics(snapshot: Snapshot, slaves: Health | EcatError) -> str:
    """Makes the text of one scrape.

    Args:
        snapshot: Statistics since the start.
        slaves: The health of the slaves, or why it is unknown.
    """
    return "\n".join([*_lines(snapshot, slaves), "# EOF", ""])


def _lines(snapshot: Snapshot, slaves: Health | EcatError) -> Iterator[str]:
    bus = {"bus": snapshot.bus}
    yield from _family("ecat_bus", "info", "The daemon.")
    yield _sample("ecat_bus_info", {**bus, "version": snapshot.version}, 1)
    yield from _gauge(
        "ecat_up", "Whether the bus is exchanged.", [(bus, int(is_exchanged(snapshot)))]
    )
    yield from _gauge(
        "ecat_problems",
        "Number of problems that ecatctl check names.",
        [(bus, len(find_problems(snapshot, slaves)))],
    )
    yield from _gauge(
        "ecat_start_time_seconds",
        "Start of the daemon.",
        [(bus, snapshot.instance / 1e9)],
        "seconds",
    )
    yield from _gauge(
        "ecat_cycle_time_seconds", "Base cycle.", [(bus, snapshot.cycle_time_ns / 1e9)], "seconds"
    )
    yield from _gauge(
        "ecat_slaves_expected", "Slaves of the bus.", [(bus, snapshot.slaves_expected)]
    )
    yield from _gauge("ecat_slaves_found", "Slaves that answer.", [(bus, snapshot.slaves_found)])
    yield from _gauge(
        "ecat_states_known",
        "Whether the bus server says how the slaves are.",
        [(bus, int(isinstance(slaves, Health)))],
    )
    if isinstance(slaves, Health):
        yield from _slaves(bus, slaves)
        yield from _faults(bus, snapshot, slaves)
    yield from _gauge(
        "ecat_link_up",
        "Whether an interface has a carrier.",
        [
            ({**bus, "interface": name}, int(link == shm.Link.UP))
            for name, link in zip(("first", "second"), snapshot.links, strict=True)
            if link != shm.Link.UNUSED
        ],
    )
    if snapshot.ring != shm.Ring.NONE:
        closed = snapshot.ring == shm.Ring.CLOSED
        yield from _gauge(
            "ecat_ring_closed", "Whether the ring of cables is closed.", [(bus, int(closed))]
        )
    if snapshot.clock.state != shm.DcState.OFF:
        locked = snapshot.clock.state == shm.DcState.LOCKED
        yield from _gauge(
            "ecat_dc_locked", "Whether the cycle follows the reference clock.", [(bus, int(locked))]
        )
    for item in shm.COUNTERS:
        yield from _counter("ecat_", item, [(bus, snapshot.counters)])
    domains = [
        ({**bus, "domain": str(domain.number), "name": domain.name}, domain.counters)
        for domain in snapshot.domains
    ]
    for item in shm.DOMAIN_COUNTERS:
        yield from _counter("ecat_domain_", item, domains)
    channels = [({**bus, "slave": str(channel.slave)}, channel) for channel in snapshot.channels]
    if channels:
        for item in shm.CAN_COUNTERS:
            rows = [(labels, channel.counters) for labels, channel in channels]
            yield from _counter("ecat_can_", item, rows)
        for name, meaning in (
            ("state", "State of a CAN controller: 1 is error active, 4 is bus-off."),
            ("send_errors", "Error counter of a CAN controller for sending."),
            ("receive_errors", "Error counter of a CAN controller for receiving."),
        ):
            yield from _gauge(
                f"ecat_can_{name}",
                meaning,
                [
                    (labels, int(channel.can_state if name == "state" else getattr(channel, name)))
                    for labels, channel in channels
                ],
            )
    for name, meaning in shm.TIMES.items():
        yield from _histogram(f"ecat_{name}_seconds", meaning, bus, snapshot.times[name])


def _slaves(bus: Mapping[str, str], slaves: Health) -> Iterator[str]:
    for name, text, count in (
        ("required", "Slaves that should be in OP.", slaves.expected),
        ("in_op", "Slaves that are in OP.", slaves.in_op),
        ("missing", "Slaves that were missing at the start.", slaves.missing),
    ):
        yield from _gauge(f"ecat_slaves_{name}", text, [(bus, count)])
    rows = required(slaves.rows)
    labels = [
        {
            **bus,
            "slave": str(row["position"]),
            "name": display_name(row.get("given_name", ""), row["name"]),
        }
        for row in rows
    ]
    if rows:
        yield from _gauge(
            "ecat_slave_in_op",
            "Whether a slave is in OP.",
            [
                (label, int(row["al_state"] == AlState.OP))
                for label, row in zip(labels, rows, strict=True)
            ],
        )
        yield from _gauge(
            "ecat_slave_al_status",
            "AL status register of a slave, 0 if it does not answer.",
            [(label, row["al_state"]) for label, row in zip(labels, rows, strict=True)],
        )


def _faults(bus: Mapping[str, str], snapshot: Snapshot, health: Health) -> Iterator[str]:
    spoilt = {fault.domain for fault in health.faults}
    yield from _gauge(
        "ecat_domain_well",
        "Whether the exchanges of a domain succeed, by the limits of [health].",
        [
            (
                {**bus, "domain": str(domain.number), "name": domain.name},
                int(domain.number not in spoilt),
            )
            for domain in snapshot.domains
        ],
    )
    if health.cables:
        yield from _gauge(
            "ecat_cable_verdict",
            "How a cable is: 0 good, 1 strained, 2 bad, -1 unknown. It ends at `port` of `slave`.",
            [
                (
                    {
                        **bus,
                        "slave": str(item["slave"]),
                        "port": str(item["port"]),
                        "before": str(item["before"]),
                        "before_port": str(item["before_port"]),
                    },
                    _VERDICTS[item["verdict"]],
                )
                for item in health.cables
            ],
        )
    if health.faults:
        yield from _gauge(
            "ecat_fault",
            "Share of the exchanges that a fault spoils; 1 for interfaces, clocks and cables.",
            [
                (
                    {
                        **bus,
                        "kind": fault.kind,
                        "domain": "" if fault.domain is None else str(fault.domain),
                        "interface": fault.interface,
                    },
                    fault.share if fault.kind in EXCHANGE else 1,
                )
                for fault in health.faults
            ],
        )


def _family(name: str, kind: str, text: str, unit: str = "") -> Iterator[str]:
    yield f"# TYPE {name} {kind}"
    if unit:
        yield f"# UNIT {name} {unit}"
    yield f"# HELP {name} {text}"


def _gauge(
    name: str, text: str, samples: Iterable[tuple[Mapping[str, str], float]], unit: str = ""
) -> Iterator[str]:
    yield from _family(name, "gauge", text, unit)
    for labels, value in samples:
        yield _sample(name, labels, value)


def _counter(
    prefix: str, item: shm.Counter, parts: Iterable[tuple[Mapping[str, str], dict[str, int]]]
) -> Iterator[str]:
    """A counter of parts of the bus. Times are in seconds, as everything is here."""
    is_time = item.unit == "ns"
    name = prefix + (f"{item.name.removesuffix('_ns')}_seconds" if is_time else item.name)
    yield from _family(name, "counter", _sentence(item.meaning), "seconds" if is_time else "")
    for labels, counters in parts:
        value = counters[item.name]
        yield _sample(f"{name}_total", labels, value / 1e9 if is_time else value)


def _sentence(meaning: str) -> str:
    return f"{meaning[0].upper()}{meaning[1:]}."


def _histogram(
    name: str, text: str, labels: Mapping[str, str], histogram: Histogram
) -> Iterator[str]:
    """A step belongs to the first bound at or above its upper edge. The bounds are much wider."""
    yield from _family(name, "histogram", _sentence(text), "seconds")
    bins = list(histogram.bins())
    below = at = 0
    for bound in _BOUNDS_NS:
        while at < len(bins) and bins[at].high_ns <= bound:
            below += bins[at].count
            at += 1
        yield _sample(f"{name}_bucket", {**labels, "le": repr(bound / 1e9)}, below)
    yield _sample(f"{name}_bucket", {**labels, "le": "+Inf"}, histogram.count)
    yield _sample(f"{name}_count", labels, histogram.count)
    yield _sample(f"{name}_sum", labels, histogram.sum_ns / 1e9)


def _sample(name: str, labels: Mapping[str, str], value: float) -> str:
    inside = ",".join(f'{key}="{_escape(text)}"' for key, text in labels.items())
    return f"{name}{{{inside}}} {value!r}"


def _escape(text: str) -> str:
    return printable(text).replace("\\", "\\\\").replace('"', '\\"')
