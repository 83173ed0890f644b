"""Writes the configuration of many slaves at the same time, for transitions of their AL states."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ecatd.base.coroutine_steps import Steps
from ecatd.base.errors import EcatError
from ecatd.base.timeouts import Timeout
from ecatd.etg.al import AlState
from ecatd.master.mailbox.talks import Talk, talk_all
from ecatd.master.master import Master

from .mapping import Scanned
from .refused import RefusedError
from .slave_configuration import SlaveConfiguration


@dataclass(frozen=True, slots=True)
class Missed:
    """Why a slave did not reach the requested state.

    Attributes:
        text: The reason, as a sentence about "it".
        changed: Whether another try is useless, since the slave's process data differ from those
            at the start, or it refuses its configuration.
    """

    text: str
    changed: bool = False


def write_parameters(
    master: Master, items: Sequence[Scanned], transition: str
) -> Steps[tuple[list[str], dict[int, Missed]]]:
    """Writes the start-up parameters of one transition.

    Returns:
        Messages about refused parameters that are optional, and, by position, why slaves cannot go
        on.
    """
    items = [item for item in items if item.settings.has_parameters(transition)]
    return (
        yield from write_configurations(
            master, items, lambda slave: slave.write_parameters(transition)
        )
    )


def write_configurations(
    master: Master,
    items: Sequence[Scanned],
    talk: Callable[[SlaveConfiguration], Talk[list[str]]],
) -> Steps[tuple[list[str], dict[int, Missed]]]:
    """Writes a part of the configuration of slaves; returns as `write_parameters`.

    Args:
        master: The master.
        items: The slaves.
        talk: Returns the conversation with one slave.
    """
    talks = [
        talk(
            SlaveConfiguration(item.slave, item.sii, master.coe(item.slave.position), item.settings)
        )
        for item in items
    ]
    found, failed = yield from talk_all(master.registers, talks)
    refused = [text for number in sorted(found) for text in found[number]]
    missed = {
        items[number].slave.position: _missed(error) for number, error in sorted(failed.items())
    }
    return refused, missed


def _missed(error: EcatError) -> Missed:
    if isinstance(error, RefusedError):
        return Missed(error.of_it, changed=True)
    return Missed(str(error))


def leave(
    master: Master, items: Sequence[Scanned], state: AlState, patience: Timeout
) -> Steps[list[str]]:
    """Writes the start-up parameters of the transitions on the way down to a state.

    The parameters of OS are written to slaves in OP, those of SP to slaves in SAFEOP, also if they
    are there with an error. A slave with parameters of SP is brought from OP to SAFEOP here, since
    the state that is requested next may be PREOP. A slave that has not answered gets no second
    request.

    Args:
        master: The master.
        items: The slaves.
        state: The state that will be requested.
        patience: Time that slaves have to reach SAFEOP.

    Returns:
        Messages about parameters that were refused or could not be written. The slaves may leave
        their states nevertheless.
    """
    told = [
        item
        for item in items
        if item.settings.has_parameters("OS") or item.settings.has_parameters("SP")
    ]
    if state == AlState.OP or not told:
        return []
    now = {item.position: item.al_state & 0x0F for item in master.al_states.read()}
    in_op = [item for item in told if now[item.slave.position] == AlState.OP]
    texts, silent = yield from write_parameters(master, in_op, "OS")
    texts += [missed.text for missed in silent.values()]
    if state == AlState.SAFEOP:
        return texts
    further = [item for item in told if item.settings.has_parameters("SP")]
    further = [item for item in further if item.slave.position not in silent]
    leaving = [item.slave.position for item in further if item in in_op]
    if leaving:
        missed = yield from master.al_states.request(AlState.SAFEOP, patience, leaving)
        now |= dict.fromkeys(leaving, AlState.SAFEOP)
        now |= {item.position: item.al_state & 0x0F for item in missed}
    in_safeop = [item for item in further if now[item.slave.position] == AlState.SAFEOP]
    refused, silent = yield from write_parameters(master, in_safeop, "SP")
    return texts + refused + [missed.text for missed in silent.values()]
