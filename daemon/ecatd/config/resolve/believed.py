"""Decides what the PDOs of a slave are, where several witnesses describe them.

CoE or SoE says which PDOs a slave exchanges. What is in a PDO is told by it, by the EEPROM, and by
the configuration. Nobody is believed where others contradict, until the configuration chooses:
equal lengths prove nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import groupby

from ecatd.description.bus import Slave
from ecatd.description.conditions import Condition
from ecatd.description.witnesses import (
    COE,
    CONFIGURATION,
    ESI,
    SII,
    SOE,
    Contradiction,
    account,
    clash,
    contradictions_text,
    witness_name,
)
from ecatd.etg.datatypes import type_by_size
from ecatd.etg.pdo import Entry, Pdo
from ecatd.etg.pdo_layout import sync_manager_bytes
from ecatd.etg.sii import Sii

from .. import PdoConfig, SlaveConfig


@dataclass(slots=True)
class Reported:
    """What a slave says of its process data; without CoE and SoE, what its EEPROM says.

    Attributes:
        outputs: Its assigned RxPDOs.
        inputs: Its assigned TxPDOs.
        unreadable: By index, why the mapping of a PDO cannot be read. Such a PDO has no entries.
        changeable: Indices of PDOs into which a master can map other entries.
        notes: Sentences without a subject about answers that make no sense, and how they are taken.
        impossible: The same about PDOs that cannot be where they are assigned. The slave is not
            used.
        silent: Whether it has CoE or SoE, but does not answer or tell. Then its EEPROM says all
            this.
    """

    outputs: list[Pdo] = field(default_factory=list)
    inputs: list[Pdo] = field(default_factory=list)
    unreadable: dict[int, str] = field(default_factory=dict)
    changeable: set[int] = field(default_factory=set)
    notes: list[str] = field(default_factory=list)
    impossible: list[str] = field(default_factory=list)
    silent: bool = False


@dataclass(slots=True)
class Believed:
    """The process data of a slave, as far as they are certain.

    Attributes:
        outputs: Its RxPDOs.
        inputs: Its TxPDOs.
        contradictions: The PDOs of which witnesses say different things.
        notes: Sentences without a subject about what is wrong, and how it is taken.
        settled: Sentences without a subject about witnesses that differ, where it is clear which
            one is right.
        condition: CONTRADICTED or UNREADABLE, if the process data are not certain; else FINE.
        why: The reason, as a sentence without a beginning.
    """

    outputs: list[Pdo] = field(default_factory=list)
    inputs: list[Pdo] = field(default_factory=list)
    contradictions: list[Contradiction] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    settled: list[str] = field(default_factory=list)
    condition: Condition = Condition.FINE
    why: str = ""


def usual_witness(slave: Slave) -> str:
    """Who says what is in the PDOs of a slave, if nobody contradicts."""
    return COE if slave.coe else SOE if slave.soe else SII


def believe(slave: Slave, sii: Sii, settings: SlaveConfig, reported: Reported) -> Believed:
    """Compares the witnesses of a slave, PDO by PDO.

    Args:
        slave: The slave.
        sii: Its SII.
        settings: Its table in the configuration.
        reported: What it says of its process data.
    """
    return _Judge(slave, sii, settings, reported).judge()


def remaining(
    slave: Slave, settings: SlaveConfig, esi: Mapping[int, tuple[Pdo, bool]]
) -> list[Contradiction]:
    """Compares what is known of the PDOs of a slave with a configuration, and with its ESI file.

    Args:
        slave: The slave, as the daemon describes it.
        settings: Its table in the configuration.
        esi: The PDOs in its ESI file, by index, and whether a master can map other entries.

    Returns:
        The contradictions; `believed` is what the configuration chooses.
    """
    usual = usual_witness(slave)
    known = {item.pdo: [*item.accounts] for item in slave.contradictions}
    for pdo in (*slave.outputs, *slave.inputs):
        known.setdefault(pdo.index, [account(pdo.witness or usual, pdo)])
    contradicted = {item.pdo for item in slave.contradictions}
    places = {**_surroundings(slave.outputs), **_surroundings(slave.inputs)}
    found = []
    for index, accounts in known.items():
        if index in settings.remapped:
            continue
        accounts = [item for item in accounts if item.witness != CONFIGURATION]
        clear = index not in contradicted
        if index in settings.described and accounts:
            entries = _entries(settings.described[index], [*accounts])
            accounts.append(account(CONFIGURATION, accounts[0], entries))
            clear = clear and not clash(accounts[0], accounts[-1])
        if index in esi and accounts:
            pdo, changeable = esi[index]
            before, last = places.get(index, (0, False))
            clear = clear and not clash(
                accounts[0], pdo, changeable=changeable, before=before, last=last
            )
            accounts.append(account(ESI, pdo))
        if not clear:
            chosen = settings.pdo_source or ""
            sure = chosen if chosen in [item.witness for item in accounts] else ""
            found.append(Contradiction(index, accounts, sure))
    return found


def _surroundings(pdos: Iterable[Pdo]) -> dict[int, tuple[int, bool]]:
    """By index: bits before a PDO in its sync manager, and whether it is the last one there."""
    found: dict[int, tuple[int, bool]] = {}
    for _, group in groupby(pdos, lambda pdo: pdo.sync_manager):
        before, together = 0, list(group)
        for pdo in together:
            found[pdo.index] = before, pdo is together[-1]
            before += pdo.bit_length
    return found


_OWN_WORDS = {COE: "its objects", SOE: "its telegrams", SII: "its objects"}


class _Judge:
    def __init__(self, slave: Slave, sii: Sii, settings: SlaveConfig, reported: Reported) -> None:
        self._slave, self._sii, self._settings, self._reported = slave, sii, settings, reported
        self._usual = SII if reported.silent else usual_witness(slave)
        self._in_sii = {pdo.index: pdo for pdo in (*sii.outputs, *sii.inputs) if pdo.entries}
        self._found = Believed(notes=list(reported.notes))
        self._unknown = list(reported.impossible)

    def judge(self) -> Believed:
        found, reported = self._found, self._reported
        found.outputs = [*self._pdos(reported.outputs)]
        found.inputs = [*self._pdos(reported.inputs)]
        undecided = [item for item in found.contradictions if not item.believed]
        if not self._unknown:
            pdos = (*found.outputs, *found.inputs)
            guessed = any(pdo.index in reported.unreadable and pdo.witness == SII for pdo in pdos)
            lengths = (_length_problem(self._sii, p) for p in (found.outputs, found.inputs))
            if guessed:
                self._unknown += filter(None, lengths)
            elif not self._settings.remapped:  # the slave itself checks its lengths before SAFEOP
                counts = "" if undecided else "; the PDOs count"
                found.settled += (f"{text}{counts}" for text in lengths if text)
        if self._unknown:
            found.condition, found.why = Condition.UNREADABLE, "; ".join(self._unknown)
            found.notes = list(reported.notes)  # nobody is believed
        elif undecided:
            found.condition, found.why = Condition.CONTRADICTED, contradictions_text(undecided)
        return found

    def _pdos(self, pdos: list[Pdo]) -> Iterator[Pdo]:
        for _, group in groupby(pdos, lambda pdo: pdo.sync_manager):
            before = 0
            together = list(group)
            for number, pdo in enumerate(together):
                taken = self._take(pdo, before, last=number == len(together) - 1)
                before += taken.bit_length
                yield taken

    def _take(self, pdo: Pdo, before: int, *, last: bool) -> Pdo:
        """The PDO as the witness describes it who is believed."""
        index, why = pdo.index, self._reported.unreadable.get(pdo.index)
        accounts = self._accounts(pdo)
        if not accounts:
            self._unknown.append(
                f"PDO 0x{index:04X} is assigned, but what is in it cannot be read ({why}), and its "
                f"EEPROM does not describe it{' as it is mapped' * (index in self._in_sii)}"
            )
            return pdo
        chosen = self._settings.pdo_source
        believed = accounts.get(chosen or "") or next(iter(accounts.values()))
        said = list(accounts.values())
        changeable = index in self._reported.changeable
        differing = [
            other
            for other in said[1:]
            if clash(said[0], other, changeable=changeable, before=before, last=last)
        ]
        if differing:
            sure = chosen if chosen in accounts else ""
            self._found.contradictions.append(Contradiction(index, said, sure or ""))
            if sure:
                text = contradictions_text(self._found.contradictions[-1:])
                self._found.settled.append(
                    f"{text}; as configured, {witness_name(sure)} is believed"
                )
        elif changeable and len(said) > 1 and clash(*said[:2]) and believed is said[0]:
            self._found.settled.append(
                f"PDO 0x{index:04X} has other entries than in its EEPROM, because they can be "
                f"mapped: {_OWN_WORDS[self._usual]} are believed"
            )
        if why is not None and believed.witness == SII:
            self._found.notes.append(
                f"what is in PDO 0x{index:04X} cannot be read ({why}), so it is taken from the "
                "EEPROM"
            )
        usual = believed.witness == self._usual
        return replace(
            pdo,
            name=pdo.name or believed.name,
            entries=[replace(entry) for entry in believed.entries],
            witness="" if usual else believed.witness,
        )

    def _accounts(self, pdo: Pdo) -> dict[str, Pdo]:
        """The PDO as its witnesses describe it; the usual one first."""
        accounts: dict[str, Pdo] = {}
        if pdo.index not in self._reported.unreadable:
            accounts[self._usual] = account(self._usual, pdo)
        known = self._in_sii.get(pdo.index)
        if known is not None and pdo.index not in self._settings.remapped:
            accounts.setdefault(SII, account(SII, known))
        if pdo.index in self._settings.described:
            entries = _entries(self._settings.described[pdo.index], [pdo, known])
            accounts[CONFIGURATION] = account(CONFIGURATION, pdo, entries)
        return accounts


def _entries(configured: PdoConfig, accounts: list[Pdo | None]) -> list[Entry]:
    """The entries of a table, with names and types that others know."""
    known = {
        (entry.index, entry.subindex, entry.bit_length): entry
        for pdo in accounts
        if pdo is not None
        for entry in pdo.entries
    }
    found = []
    for item in configured.entries:
        index, subindex = item.address
        usual = Entry(index, subindex, "", type_by_size(item.bits) if index else 0, item.bits)
        found.append(replace(known.get((index, subindex, item.bits), usual)))
    return found


def _length_problem(sii: Sii, pdos: list[Pdo]) -> str:
    """Says where the sync managers in the EEPROM contradict PDOs of one direction; else "".

    Only the PDOs that the EEPROM assigns by default are compared: lengths belong to these.
    """
    in_sii = (*sii.outputs, *sii.inputs)
    for area in sync_manager_bytes(pdos):
        if area.number >= len(sii.sync_managers):
            continue
        usual = [pdo.index for pdo in in_sii if pdo.sync_manager == area.number]
        here = [pdo.index for pdo in pdos if pdo.sync_manager == area.number]
        length = sii.sync_managers[area.number].length
        if length not in (0, area.size) and usual == here:
            return (
                f"its PDOs in sync manager {area.number} have {area.size} bytes, but the sync "
                f"manager has {length} by its EEPROM"
            )
    return ""
