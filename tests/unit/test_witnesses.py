"""What is a contradiction between witnesses of process data, and who is believed."""

from collections.abc import Callable

import pytest

from conftest import names
from ecatd.config import Config, PdoConfig, SlaveConfig
from ecatd.config.pdos import PdoEntryConfig
from ecatd.config.resolve.believed import Believed, Reported, believe, remaining
from ecatd.config.startup import StartupConfig
from ecatd.description.bus import Bus, Slave
from ecatd.description.conditions import Condition
from ecatd.description.witnesses import COE, CONFIGURATION, SII, clash, contradictions_text
from ecatd.etg.pdo import Entry, Pdo
from ecatd.etg.sii import UNASSIGNED, Sii, SiiSyncManager
from ecatd.vendor.esi.check import described_pdos
from ecatd.vendor.esi.configure import add_esi
from ecatd.vendor.esi.device import EsiDevice, EsiPdo

ENTRIES = {
    "a": (0x6000, 1, 1),
    "b": (0x6000, 2, 1),
    "w": (0x6016, 0, 16),
    "x": (0x6017, 0, 16),
    "W": (0x6016, 0, 8),
    "6": (0, 0, 6),
    "8": (0, 0, 8),
    "d": (0x0005, 0, 8),  # a dummy: the data type of 8 bits
}


def pdo(text: str, index: int = 0x1A00, manager: int = 3) -> Pdo:
    entries = [
        Entry(item, sub, letter, 0, bits)
        for letter in text
        for item, sub, bits in [ENTRIES[letter]]
    ]
    return Pdo(index, "", manager, entries)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("abw", "abw"),
        ("ab6w", "ab6w"),
        ("w8x", "wdx"),  # a dummy is a gap
        ("w88x", "w8dx"),
        ("ab6", "ab"),  # the last PDO: one byte in both
        ("wx", "w88"),  # a gap says nothing of what is there
    ],
)
def test_no_contradiction(one: str, other: str) -> None:
    assert clash(pdo(one), pdo(other), last=True) is None
    assert clash(pdo(other), pdo(one), last=True) is None


@pytest.mark.parametrize(
    ("one", "other", "changeable"),
    [
        ("abw", "ab6w", True),  # nobody maps just another gap
        ("abw", "ab6w", False),
        ("wx", "xw", False),
        ("w", "W8", False),  # another length
        ("w", "W8", True),  # nobody can choose it
        ("wx", "wab8", False),
        ("wx", "w", False),
        ("w8", "w", True),  # one byte more
    ],
)
def test_contradictions(one: str, other: str, changeable: bool) -> None:
    assert clash(pdo(one), pdo(other), changeable=changeable, last=True)
    assert clash(pdo(other), pdo(one), changeable=changeable, last=True)


@pytest.mark.parametrize(("one", "other"), [("wx", "xw"), ("wx", "w")])
def test_other_entries_where_they_can_be_mapped(one: str, other: str) -> None:
    assert clash(pdo(one), pdo(other), changeable=True) is None


def test_what_follows_makes_the_end_matter() -> None:
    assert clash(pdo("ab6"), pdo("ab"), last=False)
    assert clash(pdo("ab6"), pdo("ab"), before=6, last=True), "its last byte is another one"


# --- who is believed -----------------------------------------------------------------------------


def judge(
    coe: list[Pdo],
    sii: list[Pdo],
    settings: SlaveConfig | None = None,
    *,
    length: int = 0,
    silent: bool = False,
    unreadable: dict[int, str] | None = None,
    changeable: set[int] | None = None,
) -> Believed:
    managers = [SiiSyncManager(0x1000 + 0x100 * n, 0, 0, 1, n + 1) for n in range(4)]
    managers[3].length = length
    slave = Slave(1, "Odd", 1, 2, 3, coe=True)
    told = Reported([], coe, unreadable or {}, changeable or set(), silent=silent)
    content = Sii(inputs=sii, sync_managers=managers)
    return believe(slave, content, settings or SlaveConfig(1), told)


def layout(found: Believed) -> list[str]:
    letters = {values: letter for letter, values in ENTRIES.items()}
    return [
        "".join(letters[e.index, e.subindex, e.bit_length] for e in item.entries)
        for item in found.inputs
    ]


def table(text: str) -> PdoConfig:
    entries = [
        PdoEntryConfig(e.bit_length, None if e.is_gap else e.address) for e in pdo(text).entries
    ]
    return PdoConfig(0x1A00, entries)


def test_a_contradiction_is_told_with_both_witnesses_and_nobody_is_believed() -> None:
    found = judge([pdo("abw")], [pdo("ab6w")], length=3)  # equal lengths prove nothing
    assert found.condition == Condition.CONTRADICTED
    assert found.why == "PDO 0x1A00: CoE places 0x6016:00 at bit 2, the EEPROM at bit 8"


@pytest.mark.parametrize(
    ("settings", "expected", "witness"),
    [
        (SlaveConfig(1, pdo_source=COE), "abw", ""),
        (SlaveConfig(1, pdo_source=SII), "ab6w", SII),
        (SlaveConfig(1, pdo_source=CONFIGURATION, pdo=[table("ab8w")]), "ab8w", CONFIGURATION),
    ],
)
def test_the_configuration_chooses(settings: SlaveConfig, expected: str, witness: str) -> None:
    found = judge([pdo("abw")], [pdo("ab6w")], settings)
    assert (found.condition, layout(found)) == ("", [expected])
    assert found.inputs[0].witness == witness
    names(" ".join(found.settled), "0x6016:00 at bit 2", "believed")


@pytest.mark.parametrize(
    "settings",
    [
        SlaveConfig(1, pdo=[table("abw")]),
        SlaveConfig(1, startup=[StartupConfig("0x1A00:03", "uint32", "0x60160010")]),
    ],
)
def test_what_the_configuration_maps_is_not_compared(settings: SlaveConfig) -> None:
    found = judge([pdo("abw")], [pdo("ab6w")], settings)
    assert (found.condition, found.contradictions, layout(found)) == ("", [], ["abw"])


@pytest.mark.parametrize(
    "sii",
    [
        [],
        [pdo("", 0x1A00)],  # it describes no entries
        [pdo("ab6w", 0x1A07)],  # another default assignment
        [pdo("ab", 0x1A00, UNASSIGNED)],
    ],
)
def test_an_eeprom_that_says_nothing_of_a_pdo(sii: list[Pdo]) -> None:
    found = judge([pdo("ab")], sii)
    assert (found.condition, found.contradictions, found.notes, found.settled) == ("", [], [], [])


def test_a_length_of_another_assignment_says_nothing() -> None:
    assert judge([pdo("ab")], [pdo("ab6w", 0x1A07)], length=9).settled == []


def test_a_pdo_that_somebody_has_mapped() -> None:
    found = judge([pdo("wx")], [pdo("xw")], changeable={0x1A00})
    assert (found.condition, layout(found)) == ("", ["wx"])
    names(" ".join(found.settled), "0x1A00", "can be mapped")


THREE = [pdo("w", 0x1A00), pdo("", 0x1A14), pdo("x", 0x1A01)]
KNOWN = [pdo("w", 0x1A00), pdo("ab6", 0x1A14), pdo("x", 0x1A01)]


def test_a_mapping_that_cannot_be_read_is_that_of_the_eeprom() -> None:
    found = judge(THREE, KNOWN, unreadable={0x1A14: "no such object"}, length=5)
    assert (found.condition, layout(found)) == ("", ["w", "ab6", "x"])
    names(" ".join(found.notes), "0x1A14", "no such object", "EEPROM")


def test_a_length_that_its_sync_manager_contradicts_is_not_guessed() -> None:
    found = judge(THREE, KNOWN, unreadable={0x1A14: "no such object"}, length=6)
    assert found.condition == Condition.UNREADABLE
    names(found.why, "sync manager 3", "5 bytes", "6")
    told = judge(KNOWN, KNOWN, length=6)
    assert told.condition == "", "the slave itself checks that before SAFEOP"
    names(" ".join(told.settled), "sync manager 3", "5 bytes", "6", "count")
    unsure = judge([pdo("abw")], [pdo("ab6w")], length=9)
    assert unsure.condition == Condition.CONTRADICTED
    names(" ".join(unsure.settled), "sync manager 3", "9")
    assert "count" not in " ".join(unsure.settled), "nothing counts yet"
    other = judge(THREE[:2], KNOWN, unreadable={0x1A14: ""}, length=6)
    assert other.condition == "", "the length is that of another assignment"


def test_a_mapping_that_nobody_knows_is_refused_with_its_number() -> None:
    found = judge(THREE, [], unreadable={0x1A14: "no such object"})
    assert found.condition == Condition.UNREADABLE
    names(found.why, "0x1A14", "no such object", "EEPROM does not describe")
    described = SlaveConfig(1, pdo_source=CONFIGURATION, pdo=[table("ab6")])
    described.pdo[0].index = 0x1A14
    found = judge(THREE, [], described, unreadable={0x1A14: "no such object"})
    assert (found.condition, layout(found)) == ("", ["w", "ab6", "x"])


# --- with an ESI file ----------------------------------------------------------------------------


def esi(text: str, *, fixed: bool = True, maps: int = 0) -> EsiDevice:
    found = pdo(text)
    inputs = [EsiPdo(found.index, "", 3, found.entries, fixed=fixed)]
    facts = {"vendor_name": "V", "name": "Odd", "type": "Odd", "product": 2, "revision": 3}
    return EsiDevice("odd.xml", 1, 1, **facts, inputs=inputs, coe_details=maps)  # type: ignore[arg-type]


def slave_with(found: Believed) -> Slave:
    slave = Slave(0, "Odd", 1, 2, 3, coe=True, contradictions=found.contradictions)
    slave.inputs = [] if found.condition else found.inputs
    return slave


BOTH: Callable[[], Slave] = lambda: slave_with(judge([pdo("abw")], [pdo("ab6w")]))  # noqa: E731
ALONE: Callable[[], Slave] = lambda: slave_with(judge([pdo("abw")], []))  # noqa: E731


@pytest.mark.parametrize(
    ("slave", "device", "text"),
    [
        (
            BOTH(),
            esi("ab6w"),
            "CoE places 0x6016:00 at bit 2, the EEPROM and the ESI file at bit 8",
        ),
        (BOTH(), esi("abw"), "CoE and the ESI file place 0x6016:00 at bit 2, the EEPROM at bit 8"),
        (ALONE(), esi("ab6w"), "CoE places 0x6016:00 at bit 2, the ESI file at bit 8"),
        (ALONE(), esi("ab6w", fixed=False, maps=8), "the ESI file at bit 8"),
        (ALONE(), esi("abw"), ""),
        (ALONE(), esi("wx", fixed=False, maps=8), ""),  # somebody has mapped it
        (ALONE(), esi("wx", fixed=False), "CoE has 0x6000:01"),
        (ALONE(), esi(""), ""),
    ],
)
def test_an_esi_file_is_one_more_witness(slave: Slave, device: EsiDevice, text: str) -> None:
    found = remaining(slave, SlaveConfig(0), described_pdos(device, slave))
    assert bool(found) == bool(text)
    assert text in contradictions_text(found)


@pytest.mark.parametrize(
    ("slave", "device", "source", "tables"),
    [
        (BOTH(), esi("ab6w"), SII, 0),
        (BOTH(), esi("abw"), COE, 0),
        (ALONE(), esi("ab6w"), CONFIGURATION, 1),
        (ALONE(), esi("abw"), None, 0),
    ],
)
def test_a_configuration_with_an_esi_file_chooses_who_agrees_with_it(
    slave: Slave, device: EsiDevice, source: str | None, tables: int
) -> None:
    config = Config(slave=[SlaveConfig(0)])
    add_esi(config, Bus("b", 1000, [slave]), {0: device})
    (settings,) = config.slave
    assert (settings.pdo_source, len(settings.pdo)) == (source, tables)
    decided = remaining(slave, settings, described_pdos(device, slave))
    assert all(item.believed for item in decided)
