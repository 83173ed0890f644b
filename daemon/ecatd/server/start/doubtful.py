"""Decides how to use slaves whose process data are in doubt.

These are slaves with CoE whose mailbox does not answer or answers with nonsense, slaves with a
damaged EEPROM, which may describe only a part of the process data, slaves whose CoE and EEPROM
contradict each other, slaves that do not reach PREOP, and slaves other than the expected ones.
Slaves with lesser contradictions, and slaves without which the bus may start, are in doubt if they
do not reach SAFEOP. A doubtful slave must not keep the others from OP. If some of its process data
are known, and it reaches SAFEOP with them, it is used. Otherwise it stays in PREOP and takes no
part in the exchange: in OP it would look like a slave without process data.

A slave with SYNC signals cannot be tried, since these need the exchange. If it refuses SAFEOP or OP
later, the start begins again without it (`to_op.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

from ecatd.base.coroutine_steps import Steps, finish
from ecatd.base.durations import Patience
from ecatd.base.errors import StateError
from ecatd.description.bus import Bus, Slave
from ecatd.description.doubts import (
    CONTRADICTED,
    DAMAGED,
    REMEDIES,
    SILENT,
    STUCK,
    UNEXPECTED,
    UNREADABLE,
)
from ecatd.etg.al import AlState
from ecatd.master.al_states import why_not_reached
from ecatd.master.engine.layout import lay_out
from ecatd.master.master import Master

from .mapping import Scanned, configure

_STAYS = "stays in PREOP and takes no part"
_REASONS = {
    CONTRADICTED: f"what describes its process data is contradictory, so it {_STAYS}",
    UNREADABLE: f"its process data are not known, so it {_STAYS}",
    STUCK: "it does not reach PREOP, so it takes no part",
}
_NAMED = 3  # most problems of an EEPROM in one message


@dataclass(frozen=True, slots=True)
class Doubt:
    """The reason why the process data of a slave are in doubt.

    Attributes:
        word: One of `model.doubts`.
        text: The reason and the consequence, for messages.
    """

    word: str
    text: str


def settle(
    master: Master,
    scanned: Sequence[Scanned],
    unexpected: Mapping[int, str],
    synchronised: Collection[int],
    dispensable: Collection[int],
    left_out: Mapping[int, str],
    patience: Patience,
    tell: Callable[[str], None],
) -> dict[int, Doubt]:
    """Tries doubtful slaves in SAFEOP, and decides which of them are used. All must be in PREOP.

    Args:
        master: The master.
        scanned: All slaves. Doubtful slaves that are not used lose their process data here.
        unexpected: By position, why a slave is not the expected one. These slaves are not used.
        synchronised: Positions of slaves with SYNC signals, without which they may refuse SAFEOP.
        dispensable: Positions of slaves without which the bus may start.
        left_out: By position, why slaves refuse to go on, as an earlier try of the start has shown.
            These slaves are not used.
        patience: Time that slaves have to reach a state.
        tell: Called with a warning about each other doubtful slave, and about each EEPROM with
            lesser mistakes.

    Returns:
        The doubt about each doubtful slave, by position.
    """
    doubtful = [
        item
        for item in scanned
        if item.known
        and (item.silence or item.sii.damaged or item.doubt or item.unplaced)
        and item.slave.position not in unexpected
    ]
    described = [
        item
        for item in doubtful
        if (item.slave.outputs or item.slave.inputs) and not item.doubt and not item.unplaced
    ]
    suspects = [
        item
        for item in scanned
        if item not in doubtful
        and item.slave.position not in (*synchronised, *left_out)
        and item.slave.position not in unexpected
        and (item.slave.position in dispensable or _is_suspect(item))
        and (item.slave.outputs or item.slave.inputs)
        and item.known
    ]
    refused = finish(_try(master, [*described, *suspects], patience)) | {**left_out}
    doubtful += (n for n in scanned if n not in doubtful and n.slave.position in refused)
    doubts = {}
    for item in scanned:
        slave = item.slave
        if slave.position in unexpected:
            text = f"it is not the expected slave, so it {_STAYS}: {unexpected[slave.position]}"
            doubts[slave.position] = Doubt(UNEXPECTED, text)
            continue
        for note in item.notes:
            tell(note)
        if item not in doubtful:
            if slave.problems:
                tell(f"{slave.label}: there are mistakes in its EEPROM: {_problems(slave)}")
            continue
        used = item in described and slave.position not in refused
        unplaced = item.unplaced
        why = item.why or refused.get(slave.position) or unplaced
        if not used:
            slave.outputs, slave.inputs = [], []
        if slave.position in left_out or (item in suspects and not _is_suspect(item)):
            # Nothing but its refusal is known.
            doubt = Doubt(STUCK, f"it {_STAYS}: {why}")
        else:
            doubt = _doubt(item, used=used, why=why)
        doubts[slave.position] = doubt
        if slave.problems and doubt.word in _REASONS:
            tell(f"{slave.label}: there are mistakes in its EEPROM: {_problems(slave)}")
        if unplaced and not item.doubt:
            slave.problems.append(unplaced)
        told = f"{_name(slave)}: {doubt.text}"
        if doubt.word == SILENT:
            told = f"{item.silence}; {slave.label} {doubt.text.partition(', so it ')[2]}"
        tell(f"{told}; {REMEDIES[doubt.word]}")
    return doubts


def _is_suspect(item: Scanned) -> bool:
    """Whether the slave may refuse its process data, because its witnesses differ in something."""
    return bool(item.slave.problems or item.notes or item.settled)


def _doubt(item: Scanned, *, used: bool, why: str) -> Doubt:
    if item.doubt and not item.silence:
        return Doubt(item.doubt, f"{_REASONS[item.doubt]}: {item.why}")
    if item.silence and not item.sii.damaged:
        text = "is used with the process data of its EEPROM, and its objects cannot be reached"
        if not used:
            nothing = "its EEPROM describes no process data"
            if item.settings.is_told:  # its configuration changes the process data of its EEPROM
                nothing = "it cannot be told its configuration"
            text = f"{_STAYS}: {why or nothing}"
        did = "answered with nonsense" if item.nonsense else "did not answer"
        return Doubt(SILENT, f"its mailbox {did} at the start, so it {text}")
    text = "is used with the process data that are known of it"
    if not used:
        text = f"{_STAYS}: {why or 'no process data are known of it'}"
    if item.silence:
        text = f"{text}; {item.silence}"
    if not item.slave.problems:
        return Doubt(DAMAGED, f"it {text}")
    what = "its EEPROM is damaged" if item.sii.damaged else "there are mistakes in its EEPROM"
    return Doubt(DAMAGED, f"{what}: {_problems(item.slave)}. It {text}")


def _problems(slave: Slave) -> str:
    """Returns a text with the first problems of an EEPROM, and the number of further ones."""
    text = "; ".join(slave.problems[:_NAMED])
    more = len(slave.problems) - _NAMED
    return f"{text}; and {more} more (`ecatctl slaves --json` lists all)" if more > 0 else text


def _name(slave: Slave) -> str:
    """Returns a slave's label for messages, with its identity if its EEPROM gives no name."""
    identity = f"vendor 0x{slave.vendor:08X}, product 0x{slave.product:08X}"
    return slave.label if slave.name else f"{slave.label} ({identity})"


def _try(master: Master, items: Sequence[Scanned], patience: Patience) -> Steps[dict[int, str]]:
    """Brings slaves to SAFEOP with their process data, and back to PREOP.

    Returns:
        By position, why a slave does not reach SAFEOP.
    """
    refused = {}
    for item in items:
        slave = item.slave
        try:
            yield from configure(master, [item], lay_out(Bus("", 0, [slave]), set()))
        except StateError as error:
            refused[slave.position] = str(error)
    here = [item.slave.position for item in items if item.slave.position not in refused]
    if here:
        for missed in (yield from master.al_states.request(AlState.SAFEOP, patience, here)):
            refused[missed.position] = (
                "with the process data that are known of it, it does not reach "
                f"{why_not_reached(missed, AlState.SAFEOP, patience)}"
            )
        yield from master.al_states.request(AlState.PREOP, patience, here)
    return refused
