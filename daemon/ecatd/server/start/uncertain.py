"""Decides how to use slaves whose process data are uncertain.

These are slaves with CoE whose mailbox does not answer or answers with nonsense, slaves with a
damaged EEPROM, which may describe only a part of the process data, slaves whose CoE and EEPROM
contradict each other, slaves that do not reach PREOP, and slaves other than the expected ones.
Slaves with lesser contradictions, and slaves without which the bus may start, count among them if
they do not reach SAFEOP. An uncertain slave must not keep the others from OP. If some of its
process data are known, and it reaches SAFEOP with them, it is used. Otherwise it stays in PREOP and
takes no part in the exchange: in OP it would look like a slave without process data.

A slave with SYNC signals cannot be tried, since these need the exchange. If it refuses SAFEOP or OP
later, the start begins again without it (`to_op.py`).
"""

from __future__ import annotations

from collections.abc import Sequence

from ecatd.base.coroutine_steps import Steps, finish
from ecatd.base.errors import StateError
from ecatd.base.log import Log
from ecatd.description.bus import Bus, Slave
from ecatd.description.conditions import REMEDIES, Condition
from ecatd.etg.al import AlState
from ecatd.master.al_states import why_not_reached
from ecatd.master.engine.process_image import lay_out

from .found_bus import FoundBus
from .mapping import configure
from .scanned import Scanned, Uncertain

_CAUSES = {
    Condition.CONTRADICTED: "what describes its process data is contradictory",
    Condition.UNREADABLE: "its process data are not known",
    Condition.STUCK: "it does not reach PREOP",
}
_NAMED = 3  # most problems of an EEPROM in one message


def settle(found: FoundBus, log: Log) -> dict[int, Uncertain]:
    """Tries uncertain slaves in SAFEOP, and decides which of them are used. All must be in PREOP.

    Slaves with SYNC signals are not tried: without these they may refuse SAFEOP. Slaves that are
    not the expected ones, or have refused to go on in an earlier try of this start, are not used.

    Args:
        found: All slaves. Uncertain slaves that are not used lose their process data here.
        log: The log for a warning about each other uncertain slave, and about each EEPROM with
            lesser mistakes.

    Returns:
        What is known of each uncertain slave, by position.
    """
    scanned, unexpected, left_out = found.scanned, found.unexpected, found.refused
    untried = {item.slave for item in found.config.dc.slave} | {*left_out} | {*unexpected}
    tell = log.warning
    uncertain = [
        item
        for item in scanned
        if item.known
        and (item.silence or item.sii.damaged or item.condition or item.unplaced)
        and item.slave.position not in unexpected
    ]
    described = [
        item
        for item in uncertain
        if (item.slave.outputs or item.slave.inputs) and not item.condition and not item.unplaced
    ]
    suspects = [
        item
        for item in scanned
        if item not in uncertain
        and item.slave.position not in untried
        and (_is_suspect(item) or not found.must_be_there(item.slave.position))
        and (item.slave.outputs or item.slave.inputs)
        and item.known
    ]
    refused = finish(_try(found, [*described, *suspects])) | {**left_out}
    uncertain += (n for n in scanned if n not in uncertain and n.slave.position in refused)
    settled = {}
    for item in scanned:
        slave = item.slave
        if slave.position in unexpected:
            settled[slave.position] = Uncertain(
                Condition.UNEXPECTED,
                "it is not the expected slave",
                why=unexpected[slave.position],
            )
            continue
        for note in item.notes:
            tell(note)
        if item not in uncertain:
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
            result = Uncertain(Condition.STUCK, why=why)
        else:
            result = _describe(item, used=used, why=why)
        settled[slave.position] = result
        if slave.problems and result.condition in _CAUSES:
            tell(f"{slave.label}: there are mistakes in its EEPROM: {_problems(slave)}")
        if unplaced and not item.condition:
            slave.problems.append(unplaced)
        tell(f"{_name(slave)}: {result.text}; {REMEDIES[result.condition]}")
    return settled


def _is_suspect(item: Scanned) -> bool:
    """Whether the slave may refuse its process data, because its witnesses differ in something."""
    return bool(item.slave.problems or item.notes or item.settled)


def _describe(item: Scanned, *, used: bool, why: str) -> Uncertain:
    condition, silence = item.condition, [item.silence] if item.silence else []
    if condition and not silence:
        in_preop = condition != Condition.STUCK
        return Uncertain(condition, _CAUSES[condition], why=item.why, in_preop=in_preop)
    if silence and not item.sii.damaged:
        cause = "its mailbox did not answer at the start"
        if item.nonsense:
            cause = "its mailbox answered with nonsense at the start"
        nothing = "its EEPROM describes no process data"
        if item.settings.writes_objects:  # its configuration changes the process data of its EEPROM
            nothing = "it cannot be told its configuration"
        return Uncertain(Condition.SILENT, cause, (*silence,), used=used, why=why or nothing)
    why = why or "no process data are known of it"
    if not item.slave.problems:
        return Uncertain(Condition.DAMAGED, used=used, why=why)
    cause = "its EEPROM is damaged" if item.sii.damaged else "there are mistakes in its EEPROM"
    details = (_problems(item.slave), *silence)
    return Uncertain(Condition.DAMAGED, cause, details, used=used, why=why)


def _problems(slave: Slave) -> str:
    """Returns a text with the first problems of an EEPROM, and the number of further ones."""
    text = "; ".join(slave.problems[:_NAMED])
    more = len(slave.problems) - _NAMED
    return f"{text}; and {more} more (`ecatctl slaves --json` lists all)" if more > 0 else text


def _name(slave: Slave) -> str:
    """Returns a slave's label for messages, with its identity if its EEPROM gives no name."""
    identity = f"vendor 0x{slave.vendor:08X}, product 0x{slave.product:08X}"
    return slave.label if slave.name else f"{slave.label} ({identity})"


def _try(found: FoundBus, items: Sequence[Scanned]) -> Steps[dict[int, str]]:
    """Brings slaves to SAFEOP with their process data, and back to PREOP.

    Returns:
        By position, why a slave does not reach SAFEOP.
    """
    master, patience, refused = found.master, found.config.state_timeout, {}
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
