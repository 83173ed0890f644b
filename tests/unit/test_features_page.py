"""docs/features.md has a row for each feature of ETG.1500, and names what exists."""

import re
from pathlib import Path

import pytest

from ecatd.cli import config, startup
from ecatd.cli.commands import find_commands

DOCS = Path(__file__).parents[2] / "docs"
COLUMNS = ["no.", "feature", "A/B", "ecatd", "tests"]
ETG_1500 = {
    "101": "Service commands",
    "102": "IRQ field in datagram",
    "103": "Slaves with device emulation",
    "104": "EtherCAT state machine",
    "105": "Error handling",
    "106": "VLAN",
    "107": "EtherCAT frame types",
    "108": "UDP frame types",
    "201": "Cyclic PDO",
    "202": "Multiple tasks",
    "203": "Frame repetition",
    "301": "Online scanning, or reading ENI",
    "302": "Compare network configuration",
    "303": "Explicit device identification",
    "304": "Station alias addressing",
    "305": "Access to EEPROM",
    "401": "Support mailbox",
    "402": "Mailbox resilient layer",
    "403": "Multiple mailbox channels",
    "404": "Mailbox polling",
    "501": "SDO upload and download",
    "502": "Segmented transfer",
    "503": "Complete access",
    "504": "SDO information service",
    "505": "Emergency message",
    "506": "PDO in CoE",
    "601": "EoE protocol",
    "602": "Virtual switch",
    "603": "EoE endpoint to operating systems",
    "701": "FoE protocol",
    "702": "Firmware upload and download",
    "703": "Boot state",
    "801": "SoE services",
    "901": "AoE protocol",
    "1001": "VoE protocol",
    "1101": "DC support",
    "1102": "Continuous propagation delay compensation",
    "1103": "Sync window monitoring",
    "1201": "Slave-to-slave communication via the master",
    "1301": "Master object dictionary",
}
"""Numbers and names of the features of ETG.1500, version 1.0.2."""

FEATURE_PACKS = {
    "Cable redundancy",
    "Motion control",
    "Hot connect",
    "Device replacement",
    "External synchronization",
    "EtherCAT automation protocol",
    "Mailbox gateway",
}
ACTIONS = {"config": config._RUN, "startup": startup._RUN}


def table() -> list[dict[str, str]]:
    """The rows of the table of features, by the names of its columns."""
    section = (DOCS / "features.md").read_text().split("\n## Master classes\n")[1]
    lines = [line for line in section.split("\n## ")[0].splitlines() if line.startswith("|")]
    head, _, *rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    assert head == COLUMNS
    return [dict(zip(COLUMNS, row, strict=True)) for row in rows]


ROWS = table()


def anchors(page: Path) -> set[str]:
    """What links may name behind a #: headings in small letters, with hyphens for spaces."""
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading).lower().replace(" ", "-") for heading in headings}


def test_every_feature_of_etg_1500_has_a_row() -> None:
    numbered = [(row["no."], row["feature"]) for row in ROWS if row["no."].isdecimal()]
    assert numbered == list(ETG_1500.items())
    packs = [row["feature"] for row in ROWS if row["no."] == "FP"]
    assert (set(packs), len(packs)) == (FEATURE_PACKS, len(FEATURE_PACKS))


@pytest.mark.parametrize("row", ROWS, ids=[row["feature"] for row in ROWS])
def test_a_row_is_rated_and_names_what_exists(row: dict[str, str]) -> None:
    text = row["ecatd"]
    assert re.match(r"(yes|partly|no)\b", text)
    commands = {found.name for found in find_commands()}
    for name, action in re.findall(r"`ecatctl ([a-z-]+)(?: ([a-z-]+))?`", text):
        assert name in commands
        assert not action or action in ACTIONS[name]
    for page, anchor in re.findall(r"\]\(([a-z-]+\.md)#?([^)]*)\)", text):
        assert (DOCS / page).exists()
        assert not anchor or anchor in anchors(DOCS / page)
