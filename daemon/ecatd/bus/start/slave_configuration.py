"""Tells a slave its configuration: start-up parameters, and which PDOs it shall exchange.

This is done whenever the slave starts or comes back, in this order (ETG.1000.6):

- in PREOP: the parameters of transition IP, the modules in its slots, then the PDOs, which may
  depend on these, then the parameters of PS;
- in SAFEOP, before OP: the parameters of SO.

On the way down it is told the parameters of OS in OP, and those of SP in SAFEOP (`telling.leave`).

PDOs are written only where they differ from what the slave has, since some slaves refuse to write
what they cannot change. Before an assignment or a mapping is written, its count is set to 0.
"""

from __future__ import annotations

from collections.abc import Sequence

from ecatd.model.bus import Slave
from ecatd.model.config import TRANSITIONS_DOWN, SlaveConfig, StartupConfig
from ecatd.model.errors import SdoAbortError
from ecatd.model.pdo import Pdo
from ecatd.model.sii import UNASSIGNED, USAGE_INPUTS, USAGE_OUTPUTS, Sii

from ..mailbox.coe import Coe
from ..mailbox.mailboxes import Talk
from .assignment import ASSIGNMENT, Assignment
from .modules import Modules
from .refused import RefusedError, reason, write

_INPUTS = 0x1A00
"""The first TxPDO; PDOs below it are RxPDOs."""

Mapping = list[tuple[int, int, int]]
"""Index, subindex and bits of each entry of a PDO."""


class SlaveConfiguration:
    """Tells one slave with CoE its configuration.

    Args:
        slave: The slave.
        sii: Its SII.
        coe: CoE of the slave, for one conversation.
        settings: Its table in the configuration.
    """

    def __init__(self, slave: Slave, sii: Sii, coe: Coe, settings: SlaveConfig) -> None:
        self._slave = slave
        self._sii = sii
        self._coe = coe
        self._settings = settings
        self._assignment = Assignment(slave, sii, coe)
        self._log = coe.line.log.of("start")

    def tell(self) -> Talk[list[str]]:
        """Tells the slave, which is in PREOP, all that it is told there.

        Returns:
            Messages about parameters that it has refused, although it can be used.

        Raises:
            RefusedError: It refuses its configuration.
            NoAnswerError: It does not answer.
            StateError: Its answers are malformed.
        """
        return self._coe.talk(self._tell)

    def _tell(self) -> Talk[list[str]]:
        refused = yield from self._parameters("IP")
        if self._settings.module:
            modules = Modules(self._slave, self._sii, self._coe)
            yield from self._placed("module", modules.tell(self._settings.modules))
        if self._settings.pdos is not None or self._settings.pdo:
            key = "pdo" if self._settings.pdos is None else "pdos"
            yield from self._placed(key, self._write_pdos())
        return refused + (yield from self._parameters("PS"))

    def _placed(self, key: str, talk: Talk[None]) -> Talk[None]:
        """Adds file, line and key to what the slave refuses."""
        try:
            yield from talk
        except RefusedError as error:
            raise RefusedError(f"{self._settings.table.where(key)}: {error}") from error

    def write_parameters(self, transition: str) -> Talk[list[str]]:
        """Writes the parameters of one transition; returns and raises as `tell`."""
        return self._coe.talk(lambda: self._parameters(transition))

    def _tell_detail(self, what: str) -> None:
        self._log.debug(f"{self._slave.label} is told {what}", slaves=[self._slave.position])

    # --- start-up parameters -------------------------------------------------------------------

    def _parameters(self, transition: str) -> Talk[list[str]]:
        refused = []
        for parameter in self._settings.parameters(transition):
            index, subindex = parameter.address
            self._tell_detail(f"start-up parameter {_text(parameter)} ({transition})")
            try:
                yield from self._coe.download(
                    index, subindex, parameter.data, complete=parameter.complete
                )
            except SdoAbortError as abort:
                text = (
                    f"{parameter.table.where('object')}: {self._slave.label} refuses its start-up "
                    f"parameter {_text(parameter)}: {reason(abort)}"
                )
                if transition in TRANSITIONS_DOWN:
                    refused.append(f"{text}; it goes down all the same")
                elif parameter.optional:
                    refused.append(f"{text}; it is optional, so the slave is used")
                else:
                    raise RefusedError(
                        f"{text}; correct the value, or write optional = true"
                    ) from abort
        return refused

    # --- PDOs ----------------------------------------------------------------------------------

    def _write_pdos(self) -> Talk[None]:
        outputs, inputs = yield from self._assignment.pdos()
        before = {pdo.index: pdo for pdo in (*outputs, *inputs)}
        wanted = self._wanted(before)
        mappings = yield from self._changed_mappings(before)
        managers = [
            number
            for number, indices in wanted.items()
            if indices != [pdo.index for pdo in before.values() if pdo.sync_manager == number]
            or any(index in mappings for index in indices)
        ]
        for number in managers:
            yield from self._write(ASSIGNMENT + number, 0, "B", 0, "its PDO assignment")
        for index, mapping in mappings.items():
            yield from self._write_mapping(index, mapping)
        for number in managers:
            for at, index in enumerate(wanted[number], 1):
                yield from self._write(
                    ASSIGNMENT + number, at, "H", index, f"PDO 0x{index:04X}{self._offer(index)}"
                )
            count = len(wanted[number])
            yield from self._write(
                ASSIGNMENT + number, 0, "B", count, f"an assignment of {count} PDOs"
            )
        yield from self._verify(wanted)

    def _wanted(self, before: dict[int, Pdo]) -> dict[int, list[int]]:
        """The indices of the PDOs that each sync manager shall carry, by its number."""
        channels = {usage: self._sii.channels(usage) for usage in (USAGE_OUTPUTS, USAGE_INPUTS)}
        wanted: dict[int, list[int]] = {
            number: [] for numbers in channels.values() for number in numbers
        }
        places = {pdo.index: pdo.sync_manager for pdo in (*self._sii.outputs, *self._sii.inputs)}
        places |= {index: pdo.sync_manager for index, pdo in before.items()}
        indices = list(before) if self._settings.pdos is None else self._settings.pdos
        for index in indices:
            usage = USAGE_INPUTS if index >= _INPUTS else USAGE_OUTPUTS
            number = places.get(index, UNASSIGNED)
            if number not in channels[usage]:
                if not channels[usage]:
                    raise RefusedError(
                        f"{self._slave.label} has no sync manager for "
                        f"{'inputs' if usage == USAGE_INPUTS else 'outputs'}, so PDO "
                        f"0x{index:04X} cannot be assigned: remove it from pdos"
                    )
                number = channels[usage][0]
            wanted[number].append(index)
        return wanted

    def _changed_mappings(self, before: dict[int, Pdo]) -> Talk[dict[int, Mapping]]:
        """The configured mappings that differ from those of the slave, by index of the PDO."""
        changed = {}
        for pdo in self._settings.pdo:
            wanted = [(*entry.address, entry.bits) for entry in pdo.entries]
            if pdo.index in before:
                now = before[pdo.index]
            else:
                now = yield from self._assignment.pdo(pdo.index, UNASSIGNED)
            if wanted == _mapping(now):
                continue
            if pdo.index in self._sii.fixed:
                raise RefusedError(
                    f"{self._slave.label}: the entries of PDO 0x{pdo.index:04X} are fixed, so "
                    f"they cannot be mapped: remove its [[slave.pdo]], or choose another PDO"
                )
            changed[pdo.index] = wanted
        return changed

    def _write_mapping(self, index: int, mapping: Mapping) -> Talk[None]:
        pdo = f"PDO 0x{index:04X}"
        yield from self._write(index, 0, "B", 0, f"another mapping of {pdo}")
        for number, (object_, subindex, bits) in enumerate(mapping, 1):
            entry = f"0x{object_:04X}:{subindex:02X}" if object_ else "a gap"
            value = object_ << 16 | subindex << 8 | bits
            yield from self._write(
                index, number, "I", value, f"entry {number} of {pdo} ({entry}, {bits} bits)"
            )
        yield from self._write(index, 0, "B", len(mapping), f"{pdo} with {len(mapping)} entries")

    def _write(self, index: int, subindex: int, form: str, value: int, what: str) -> Talk[None]:
        self._tell_detail(what)
        return write(self._slave, self._coe, (index, subindex), form, value, what)

    def _offer(self, index: int) -> str:
        """The PDOs of the same direction that its EEPROM describes, for messages."""
        pdos = self._sii.inputs if index >= _INPUTS else self._sii.outputs
        offered = ", ".join(f"0x{pdo.index:04X}" for pdo in pdos)
        return f" (its EEPROM offers {offered})" if offered else ""

    def _verify(self, wanted: dict[int, list[int]]) -> Talk[None]:
        """Reads the PDOs back: some slaves accept what they do not use."""
        outputs, inputs = yield from self._assignment.pdos()
        own = {pdo.index: pdo for pdo in self._settings.pdo}
        for number, indices in wanted.items():
            now = [pdo for pdo in (*outputs, *inputs) if pdo.sync_manager == number]
            if [pdo.index for pdo in now] != indices:
                raise RefusedError(
                    f"{self._slave.label} has accepted the PDOs {_indices(indices)} in sync "
                    f"manager {number}, but has {_indices([pdo.index for pdo in now])}"
                )
            for pdo in now:
                if pdo.index in own:
                    mapping = [(*entry.address, entry.bits) for entry in own[pdo.index].entries]
                    if _mapping(pdo) != mapping:
                        raise RefusedError(
                            f"{self._slave.label} has accepted the mapping of PDO "
                            f"0x{pdo.index:04X}, but has another one"
                        )


def choose_from_sii(slave: Slave, sii: Sii, settings: SlaveConfig) -> None:
    """Sets the PDOs of a slave without CoE to those of its SII that the configuration names.

    Raises:
        ConfigError: The SII does not have them.
    """
    if settings.pdos is None:
        return
    found: dict[int, Pdo] = {pdo.index: pdo for pdo in (*sii.outputs, *sii.inputs)}
    for index in settings.pdos:
        if index not in found:
            offered = _indices(list(found)) or "none"
            settings.table.fail(
                "pdos",
                f"{slave.label} has no PDO 0x{index:04X}: its EEPROM offers {offered}; choose "
                "among them, or leave pdos out",
            )
    chosen = [found[index] for index in settings.pdos]
    for pdo in chosen:
        if pdo.sync_manager == UNASSIGNED:
            usage = USAGE_INPUTS if pdo.index >= _INPUTS else USAGE_OUTPUTS
            pdo.sync_manager = sii.channels(usage)[0]
    slave.outputs = [pdo for pdo in chosen if pdo.index < _INPUTS]
    slave.inputs = [pdo for pdo in chosen if pdo.index >= _INPUTS]


def _mapping(pdo: Pdo) -> Mapping:
    return [(entry.index, entry.subindex, entry.bit_length) for entry in pdo.entries]


def _indices(indices: Sequence[int]) -> str:
    return ", ".join(f"0x{index:04X}" for index in indices) or "none"


def _text(parameter: StartupConfig) -> str:
    value = parameter.value if parameter.hex is None else parameter.hex
    return f"{parameter.object} = {value}"
