"""What is wrong with a bus, for `ecatctl check` and the metrics.

The bus server knows it (`operations/health.py`). If it does not
answer, the shared memory says less.
"""

from __future__ import annotations

from collections.abc import Iterator

from ecatd.base.errors import EcatError
from ecatd.etg.al import AlState
from ecatd.operations.health import Health

from .. import contract as shm
from .snapshot import Snapshot

NOT_IN_STEP = "the cycle is not in step with the reference clock"


def is_exchanged(snapshot: Snapshot) -> bool:
    """Whether the daemon exchanges cycles."""
    return snapshot.state == shm.BusState.RUNNING and not snapshot.silence


def find_problems(snapshot: Snapshot, slaves: Health | EcatError | None = None) -> list[str]:
    """Returns a text for each problem of a bus.

    Args:
        snapshot: Statistics since the start.
        slaves: The health of the bus, or why it is unknown; None if nobody has asked.
    """
    if snapshot.state != shm.BusState.RUNNING:
        return [f"the daemon is {word(snapshot.state)}"]
    if snapshot.silence:
        return [f"no cycle for {snapshot.silence:.1f} s: the exchange stands still"]
    if isinstance(slaves, Health):
        return slaves.problems
    problems = [*_wire_problems(snapshot), *_seen_from_here(snapshot)]
    return problems if slaves is None else [*problems, str(slaves)]


def _wire_problems(snapshot: Snapshot) -> Iterator[str]:
    yield from link_problems(snapshot)
    if snapshot.clock.state == shm.DcState.LOCKING:
        yield NOT_IN_STEP


def link_problems(snapshot: Snapshot) -> Iterator[str]:
    """A text for each interface without a link, and for an open ring."""
    names = ("the interface", "the second interface")
    for name, link in zip(names, snapshot.links, strict=True):
        if link == shm.Link.NO_CARRIER:
            yield f"{name} has {word(link)}"
        elif link not in (shm.Link.UNUSED, shm.Link.UP):
            yield f"{name} is {word(link)}"
    if snapshot.ring == shm.Ring.OPEN:
        yield f"ring {ring_text(snapshot)}"


def _seen_from_here(snapshot: Snapshot) -> Iterator[str]:
    """What the shared memory says of exchange and slaves, if no gateway answers for them."""
    for domain in snapshot.domains:
        if domain.counters["exchanges"] and domain.wkc_state != shm.WkcState.COMPLETE:
            yield (
                f"the last exchange of domain {domain.number} was not complete (working counter "
                f"{domain.wkc} of {domain.wkc_expected})"
            )
    if snapshot.slaves_found < snapshot.slaves_expected:
        yield f"{snapshot.slaves_found} of {snapshot.slaves_expected} slaves answer"
    if snapshot.slaves_found and snapshot.al_status != AlState.OP:
        yield "slaves are not in OP"


def ring_text(snapshot: Snapshot) -> str:
    """The state of cable redundancy, as words behind `ring`."""
    second = f"second interface {word(snapshot.links[1])}"
    if snapshot.ring == shm.Ring.NONE:
        return "none: one interface"
    if not snapshot.slaves_found:
        return f"unknown while no frame comes back, {second}"
    if snapshot.ring == shm.Ring.CLOSED:
        return f"closed, {second}"
    before = snapshot.ring_break
    if before == 0:
        place = "in front of slave 0"
    elif before == snapshot.slaves_expected:
        place = f"behind slave {before - 1}"
    else:
        place = f"between slaves {before - 1} and {before}"
    return f"OPEN {place}, {second}"


def word(member: shm.Link | shm.Ring | shm.BusState | shm.DcState) -> str:
    """Name of a state in words, such as `no carrier`."""
    return member.name.lower().replace("_", " ")
