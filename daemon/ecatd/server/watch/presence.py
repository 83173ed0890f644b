"""What is said of slaves that are missing, and of those that are new."""

from __future__ import annotations

from collections.abc import Sequence

from ecatd.description.bus import Bus, positions_text


def name_slaves(bus: Bus, positions: Sequence[int]) -> str:
    """How messages name one slave or several: `slave 2 (EL1018)`, `slaves 0, 3-7`."""
    if len(positions) == 1:
        return bus.slaves[positions[0]].label
    return f"slaves {positions_text(positions)}"


def describe_presence(
    bus: Bus,
    found: int,
    lost: Sequence[int],
    added: int = 0,
    twice: Sequence[int] = (),
    *,
    absent: int = 0,
    by_hand: bool = False,
    blinding: str = "",
    restart: str = "",
) -> str:
    """What is wrong with the number of slaves, in words; empty if nothing is.

    Args:
        bus: The bus as it was brought up.
        found: Slaves that answer a broadcast.
        lost: Positions of those that do not answer at their address, and must be there.
        added: Where there are more: position of the first new one.
        twice: Positions of those at whose address another device answers, too.
        absent: Number of optional slaves that do not answer at their address.
        by_hand: Whether slaves that were without power do not come back by themselves.
        blinding: Why no frame can come back, as the interfaces know it: it is no fault of slaves.
        restart: What a restart would do without those that are lost, for the end of the sentence.

    What a restart would do with others is told by `expectation.py`, when it knows who they are.
    """
    if twice:
        each, where = ("its", "address") if len(twice) == 1 else ("their", "addresses")
        return (
            f"two devices answer at the {where} of {name_slaves(bus, twice)}, and both get {each} "
            f"outputs: one was cut off but kept its power, and the other has replaced it; remove "
            f"one of them, or switch one off and on"
        )
    count = len(bus.slaves) - absent
    if found > count + absent:  # up to that, they may be optional slaves that are coming
        who = "a slave was" if found == count + 1 else f"{found - count} slaves were"
        where = f"behind {bus.slaves[added - 1].label}" if added else "in front of all others"
        return f"slave count changed: {count}, now {found}: {who} added {where}"
    if not lost:
        return ""
    command = f"`ecatctl state {lost[0]} OP`" if len(lost) == 1 else "`ecatctl state OP`"
    ask = f"; {command} brings back what is there" if by_hand else ""
    if len(lost) == count:
        if found:
            return (
                f"no slave answers at its address, though {found} are there: they were switched "
                f"off and on, or exchanged{ask}"
            )
        if blinding:
            return f"no slave answers, since no frame comes back: {blinding}"
        return (
            f"no slave answers: check the cable to {bus.slaves[0].label} and the power; the bus "
            f"goes on by itself when the slaves answer again"
        )
    if found == count:
        return (
            f"no answer from {name_slaves(bus, lost)} at {'its' if len(lost) == 1 else 'their'} "
            f"address, though {count} slaves are there: switched off and on, or exchanged{ask}"
        )
    first = bus.slaves[lost[0]]
    missing = f"{len(lost)} slave{'s' * (len(lost) != 1)} missing"
    if list(lost) == list(range(lost[0], count)):
        before = bus.slaves[lost[0] - 1].label
        return (
            f"slave count changed: {count}, now {found}: no answer from {first.label} on: "
            f"{missing}; check the cable behind {before}, and the power of {first.label}{restart}"
        )
    return (
        f"slave count changed: {count}, now {found}: no answer from {name_slaves(bus, lost)}: "
        f"{missing}; check cables and power{restart}"
    )
