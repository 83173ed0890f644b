"""Writes the configuration of slaves: start-up parameters, modules, and PDOs.

This is done whenever a slave starts or comes back, in this order (ETG.1000.6):

- in PREOP: the parameters and IDNs of transition IP, the modules in its slots, then the PDOs,
  which may depend on all of them, then the parameters and IDNs of PS, and the IP parameters;
- in SAFEOP, before OP: the parameters of SO.

On the way down, the parameters of OS are written in OP, and those of SP in SAFEOP (`leave`). Many
slaves are served at the same time.

`pdo_writer.py` writes the PDOs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ecatd.base.coroutine_steps import Steps
from ecatd.base.errors import EcatError, NoAnswerError, SdoAbortError, StateError, UsageError
from ecatd.base.timeouts import Timeout
from ecatd.config import TRANSITIONS_DOWN, StartupConfig
from ecatd.config.eoe import SlaveEoeConfig
from ecatd.etg.al import AlState
from ecatd.master.mailbox.coe import Coe
from ecatd.master.mailbox.conversation import Conversation, run_conversations
from ecatd.master.mailbox.eoe import set_ip
from ecatd.master.mailbox.soe import SoeRefusedError, read_attribute, write_idn
from ecatd.master.master import Master

from .modules import Modules
from .object_access import RefusedError, reason
from .pdo_writer import PdoWriter
from .scanned import Scanned, SlaveMailbox


class SlaveConfiguration(SlaveMailbox):
    """Writes the configuration of one slave with a mailbox."""

    def __init__(self, item: Scanned, coe: Coe) -> None:
        super().__init__(item, coe)
        self._log = coe.queue.log.of("start")

    def write(self) -> Conversation[list[str]]:
        """Writes the whole configuration for PREOP to the slave, which must be in PREOP.

        Returns:
            Messages about refused parameters that are optional.

        Raises:
            RefusedError: The slave refuses its configuration.
            NoAnswerError: It does not answer.
            StateError: Its answers are malformed.
        """
        return self._coe.converse(self._write)

    def _write(self) -> Conversation[list[str]]:
        refused = yield from self._written("IP")
        if self._settings.module:
            modules = Modules(self._item, self._coe)
            yield from self._placed("module", modules.write(self._settings.modules))
        if self._slave.coe and (self._settings.pdos is not None or self._settings.mapped):
            key = "pdo" if self._settings.pdos is None else "pdos"
            pdos = PdoWriter(self._item, self._coe, self._log_detail)
            yield from self._placed(key, pdos.write())
        refused += yield from self._parameters("PS")
        refused += yield from self._idns("PS")
        if self._slave.eoe and self._settings.eoe is not None:
            yield from self._give_ip(self._settings.eoe)
        return refused

    def _give_ip(self, eoe: SlaveEoeConfig) -> Conversation[None]:
        parameters = eoe.parameters
        self._log_detail(f"IP parameters: {parameters.interface or parameters.mac}")
        try:
            yield from set_ip(self._coe.mailbox, parameters)
        except NoAnswerError as error:
            where = eoe.table.where()
            raise NoAnswerError(f"{where}: no answer to its IP parameters: {error}") from error
        except StateError as error:
            why = f"refuses its IP parameters: {error}; correct or remove [slave.eoe]"
            raise RefusedError(self._slave, why, eoe.table.where()) from error

    def _placed(self, key: str, conversation: Conversation[None]) -> Conversation[None]:
        """Runs `conversation`, and adds file, line and key to the message of a `RefusedError`."""
        try:
            yield from conversation
        except RefusedError as error:
            where = self._settings.table.where(key)
            raise RefusedError(self._slave, error.why, where) from error

    def write_parameters(self, transition: str) -> Conversation[list[str]]:
        """Writes the parameters of one transition; returns and raises as `write`."""
        return self._coe.converse(lambda: self._written(transition))

    def _written(self, transition: str) -> Conversation[list[str]]:
        refused = yield from self._parameters(transition)
        return refused + (yield from self._idns(transition))

    def _log_detail(self, what: str) -> None:
        self._log.debug(f"{self._slave.label} gets {what}", slaves=[self._slave.position])

    # --- start-up parameters -------------------------------------------------------------------

    def _parameters(self, transition: str) -> Conversation[list[str]]:
        refused = []
        for parameter in self._settings.parameters(transition):
            index, subindex = parameter.address
            self._log_detail(f"start-up parameter {_text(parameter)} ({transition})")
            try:
                yield from self._coe.download(
                    index, subindex, parameter.data, complete=parameter.complete
                )
            except SdoAbortError as abort:
                why = f"refuses its start-up parameter {_text(parameter)}: {reason(abort)}"
                if "object" not in parameter.table:  # it follows from another table
                    why += "; correct or remove the table"
                    raise RefusedError(self._slave, why, parameter.table.where()) from abort
                error = RefusedError(self._slave, why, parameter.table.where("object"))
                refused.append(_refused(error, transition, optional=parameter.optional))
        return refused

    def _idns(self, transition: str) -> Conversation[list[str]]:
        refused = []
        mailbox = self._coe.mailbox
        for idn in self._settings.idns(transition):
            self._log_detail(f"IDN {idn} ({transition})")
            try:
                attribute = yield from read_attribute(mailbox, idn.drive, idn.number)
                data = idn.data(attribute)
                if not attribute.is_list and attribute.size not in (0, len(data)):
                    raise UsageError(f"it takes {attribute.size} bytes, not {len(data)}")
                is_list = attribute.is_list
                yield from write_idn(mailbox, idn.drive, idn.number, data, is_list=is_list)
            except (SoeRefusedError, UsageError) as problem:
                why = f"cannot take the IDN {idn}: {problem}"
                error = RefusedError(self._slave, why, idn.table.where("idn"))
                refused.append(_refused(error, transition, optional=idn.optional))
        return refused


def _refused(error: RefusedError, transition: str, *, optional: bool) -> str:
    """Returns a message about a refused parameter with what follows.

    Raises:
        RefusedError: The slave must have it.
    """
    if transition in TRANSITIONS_DOWN:
        return f"{error}; its state is changed nevertheless"
    if optional:
        return f"{error}; it is optional, so the slave is used"
    what_to_do = "correct the value, or write optional = true"
    raise RefusedError(error.slave, f"{error.why}; {what_to_do}", error.where)


def _text(parameter: StartupConfig) -> str:
    value = parameter.value if parameter.hex is None else parameter.hex
    return f"{parameter.object} = {value}"


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
    conversation: Callable[[SlaveConfiguration], Conversation[list[str]]],
) -> Steps[tuple[list[str], dict[int, Missed]]]:
    """Writes a part of the configuration of slaves; returns as `write_parameters`.

    Args:
        master: The master.
        items: The slaves.
        conversation: Returns the conversation with one slave.
    """
    conversations = [
        conversation(SlaveConfiguration(item, master.coe(item.slave.position))) for item in items
    ]
    found, failed = yield from run_conversations(master.registers, conversations)
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
    listed = [
        item
        for item in items
        if item.settings.has_parameters("OS") or item.settings.has_parameters("SP")
    ]
    if state == AlState.OP or not listed:
        return []
    now = {item.position: item.al_state & 0x0F for item in master.al_states.read()}
    in_op = [item for item in listed if now[item.slave.position] == AlState.OP]
    texts, silent = yield from write_parameters(master, in_op, "OS")
    texts += [missed.text for missed in silent.values()]
    if state == AlState.SAFEOP:
        return texts
    further = [item for item in listed if item.settings.has_parameters("SP")]
    further = [item for item in further if item.slave.position not in silent]
    leaving = [item.slave.position for item in further if item in in_op]
    if leaving:
        missed = yield from master.al_states.request(AlState.SAFEOP, patience, leaving)
        now |= dict.fromkeys(leaving, AlState.SAFEOP)
        now |= {item.position: item.al_state & 0x0F for item in missed}
    in_safeop = [item for item in further if now[item.slave.position] == AlState.SAFEOP]
    refused, silent = yield from write_parameters(master, in_safeop, "SP")
    return texts + refused + [missed.text for missed in silent.values()]
