"""docs/configuration-keys.md is up to date, and ecatd reads a file as the page says."""

import re
import tomllib
from pathlib import Path
from typing import NamedTuple

import pytest

from ecatd.base.errors import ConfigError
from ecatd.config import Config, SafeConfig, SlaveConfig, read_config
from ecatd.config.placed import rules_of
from ecatd.master.mailbox.mailbox_queue import MailboxQueue
from ecatdev.configuration_page import page, sections
from ecatdev.page_parts import attributes

PAGE = Path(__file__).parents[2] / "docs" / "configuration-keys.md"
COMMAND = (
    "PYTHONPATH=tools .venv/bin/python -m ecatdev.configuration_page docs/configuration-keys.md"
)

NEEDED = {
    "[[slave]]": "position = 0",
    "[[slave.module]]": "slot = 1\nident = 1",
    "[[slave.pdo]]": "index = 0x1600\nentries = []",
    "[[slave.pdo.entries]]": "bits = 8",
    "[[slave.startup]]": "object = '0x6065:00'\nhex = '00'",
    "[[slave.idn]]": "idn = 'S-0-0036'\nvalue = 1",
    "[[dc.slave]]": "slave = 0",
    "[[outputs.safe]]": "slave = 0\nvalue = 'quick_stop'",
    "[slave.can]": "bit_rate = 500",
    "[[slave.can.safe]]": "id = 0",
    "[[signal]]": "slave = 0\nentry = '0x6000:01'",
    "[[copy]]": "slave = 1\nentry = '0x7000:01'\nfrom_slave = 0\nfrom_entry = '0x6000:01'",
    "[[gateway.user]]": "name = 'anna'",
    "[[ros.joint]]": "slave = 0",
    "[[flight_recorder.condition]]": "signal = '0/0x6000:01'\nabove = 1",
}
"""Keys without which a table is refused."""
ABOVE = {
    "[[slave.pdo.entries]]": "[[slave]]\nposition = 0\n[[slave.pdo]]\nindex = 0x1600\n",
    "[[slave.can.safe]]": "[[slave]]\nposition = 0\n[slave.can]\nbit_rate = 500\n",
    "[[ros.joint]]": "[ros]\nconnect = 'tcp/localhost:7448'\n",
    "[[gateway.user]]": "[gateway]\nusers_ca = '/ca.pem'\n",
    **dict.fromkeys(
        (
            "[[slave.module]]",
            "[[slave.pdo]]",
            "[[slave.startup]]",
            "[[slave.idn]]",
            "[slave.eoe]",
            "[slave.can]",
        ),
        "[[slave]]\nposition = 0\n",
    ),
}
"""What stands in a file in front of a table."""
NO_NUMBER = ("bus", "slaves", "index", "pdos", "hex", "listen", "connect")
"""Keys with numbers in their range, but values of another kind."""
LITERAL = {
    "mailbox_timeout_ms": 1000 * MailboxQueue().answer_s,
    "mailbox_tries": MailboxQueue().tries,
    "mailbox_poll_ms": 1000 * SlaveConfig(0).poll_s,
    "stop_timeout_s": SafeConfig(0).stop_timeout,
}
"""Keys that are None if they are missing, and what is used then."""


class Row(NamedTuple):
    header: str
    key: str
    default: str
    range: str
    meaning: str

    def config(self, value: str | None) -> Config:
        """What is read of a file with this key, or of the same one without it."""
        others = NEEDED.get(self.header, "").splitlines()
        lines = [line for line in others if not line.startswith(f"{self.key} =")]
        if value is not None:
            lines.append(f"{self.key} = {value}")
        text = "\n".join([f"{ABOVE.get(self.header, '')}{self.header}", *lines])
        return read_config(tomllib.loads(text))


def rows() -> list[Row]:
    found, header = [], ""
    for line in PAGE.read_text().splitlines():
        if line.startswith("## "):
            header = line[3:].strip("`") if "[" in line else ""
        elif line.startswith("| `"):
            key, *others = (cell.strip() for cell in line.strip("|").split(" | "))
            found.append(Row(header, key.strip("`"), *others))
    return found


def test_it_is_up_to_date() -> None:
    assert PAGE.read_text() == page(), f"{PAGE.name} is out of date; run: {COMMAND}"


def test_docstrings_have_all_keys() -> None:
    for kind in (Config, *(section.kind for section in sections())):
        assert {*attributes(kind)} == {*rules_of(kind)}


@pytest.mark.parametrize("row", rows(), ids=lambda row: f"{row.header}{row.key}")
def test_a_key_is_read_as_the_page_says(row: Row) -> None:
    words = re.sub(r"(?<=\d) (?=\d)", "", row.range).replace(",", "").split()
    numbers = [word for word in words if re.fullmatch(r"-?(0x[0-9A-F]+|[0-9.]+)", word)]
    if "to" in words and numbers and row.key not in NO_NUMBER:
        for beyond in ("10_000_000_000", "-10_000_000"):
            with pytest.raises(ConfigError) as caught:
                row.config(beyond)
            bounds = re.search(r"must be from (\S+) to (\S+)$", str(caught.value))
            assert bounds, (row, caught.value)
            assert [*map(float, bounds.groups())] == [
                float(int(n, 16) if n.startswith("0x") else n) for n in (numbers[0], numbers[-1])
            ]
    literal = re.fullmatch("`([^`]+)`", row.default)
    if literal and row.key not in LITERAL:
        assert row.config(literal[1]) == row.config(None)


def test_defaults_that_are_used_elsewhere_are_right() -> None:
    said = {row.key: float(row.default.strip("`")) for row in rows() if row.key in LITERAL}
    assert said == LITERAL
