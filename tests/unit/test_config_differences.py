"""Two configurations are compared by what their tables are about, and not by their numbers."""

from pathlib import Path
from typing import Any

import pytest

from ecatd.config import load_config
from ecatd.config.differences import differences

SLAVES = "".join(
    f"[[slave]]\nposition = {{{n}}}\nvendor = 2\nproduct = {product}\n"
    for n, product in enumerate((1, 5, 7, 7))
)
"""Four slaves without names; two are alike."""

NAMED = """
[[slave]]
position = 0
name = "feed"
[[slave.startup]]
object = "0x2000:00"
type = "uint8"
value = 1
[[slave.startup]]
object = "0x2001:00"
type = "uint8"
value = 1
[[slave.pdo]]
index = 0x1A00
entries = [{ object = "0x6000:01", bits = 8 }]
[[slave]]
position = 1
name = "press"
[[signal]]
slave = "feed"
entry = "0x6000:01"
unit = "V"
[[signal]]
slave = "press"
entry = "0x6000:01"
unit = "A"
[[copy]]
slave = "press"
entry = "0x7000:01"
from_slave = "feed"
from_entry = "0x6000:01"
[[outputs.safe]]
slave = "press"
value = "hold"
[[domain]]
[[domain]]
name = "slow"
divider = 4
slaves = ["press"]
[[domain]]
divider = 2
slaves = ["feed"]
"""


def compared(tmp_path: Path, before: str, after: str) -> tuple[dict[str, Any], list[Any]]:
    """The two values of each key that differs; and the slaves that have moved."""
    files = tmp_path / "before.toml", tmp_path / "after.toml"
    for file, text in zip(files, (before, after), strict=True):
        file.write_text(text)
    found = differences(*map(load_config, files))
    moved = [(item.slave, item.before, item.after) for item in found.moved]
    return {item.key: (item.before, item.after) for item in found.found}, moved


@pytest.mark.parametrize(
    ("old", "new", "keys"),
    [
        ('unit = "V"', 'unit = "mV"', ["signal[feed 0x6000:01].unit"]),
        (
            '[[signal]]\nslave = "feed"',
            "[[signal]]\nslave = 'feed'\nentry = '0x6001:01'\n[[signal]]\nslave = \"feed\"",
            ["signal[feed 0x6001:01]"],
        ),
        (
            '[[signal]]\nslave = "feed"\nentry = "0x6000:01"\nunit = "V"\n',
            "",
            ["signal[feed 0x6000:01]"],
        ),
        ('name = "feed"', 'name = "feed"\nwatchdog_ms = 5', ["slave[feed].watchdog_ms"]),
        (
            "[[slave.startup]]",
            "[[slave.startup]]\nobject = '0x1FFF:00'\nhex = '00'\n[[slave.startup]]",
            ["slave[feed].startup[0x1FFF:00 PS]"],
        ),
        (
            "value = 1\n[[slave.pdo]]",
            "value = 2\n[[slave.pdo]]",
            ["slave[feed].startup[0x2001:00 PS].value"],
        ),
        (
            'object = "0x2001:00"',
            'object = "0x2000:00"',
            ["slave[feed].startup[0x2001:00 PS]", "slave[feed].startup[0x2000:00 PS #2]"],
        ),
        ("bits = 8", "bits = 16", ["slave[feed].pdo[0x1A00].entries"]),
        (
            'from_entry = "0x6000:01"',
            'from_entry = "0x6000:02"',
            ["copy[press 0x7000:01].from_entry"],
        ),
        ('value = "hold"', 'value = "zero"', ["outputs.safe[press].value"]),
        (
            "[[domain]]\nname",
            "[[domain]]\ndivider = 9\nslaves = [7]\n[[domain]]\nname",
            ["domain[1]"],
        ),
        ("divider = 2\nslaves", "divider = 3\nslaves", ["domain[2].divider"]),
    ],
)
def test_one_change_is_one_difference(tmp_path: Path, old: str, new: str, keys: list[str]) -> None:
    changed = NAMED.replace(old, new, 1)
    assert changed != NAMED
    assert [*compared(tmp_path, NAMED, changed)[0]] == keys
    assert [*compared(tmp_path, NAMED, NAMED)[0]] == []


def test_the_order_counts_where_it_means_something(tmp_path: Path) -> None:
    swapped = NAMED.replace("0x2000:00", "x").replace("0x2001:00", "0x2000:00").replace("x:", "0x:")
    swapped = swapped.replace('"x"', '"0x2001:00"')
    found, _ = compared(tmp_path, NAMED, swapped)
    one, other = "0x2000:00 PS", "0x2001:00 PS"
    assert found == {"slave[feed].startup (order)": ([one, other], [other, one])}
    signals = NAMED[NAMED.index("[[signal]]") : NAMED.index("[[copy]]")]
    first, second = signals.split("[[signal]]")[1:]
    reordered = NAMED.replace(signals, f"[[signal]]{second}[[signal]]{first}")
    assert compared(tmp_path, NAMED, reordered)[0] == {}


def test_an_inserted_slave_is_one_difference(tmp_path: Path) -> None:
    rules = "[[signal]]\nslave = {}\nentry = '0x6000:01'\nunit = 'V'\n[[domain]]\nslaves = [{}]\n"
    before = SLAVES.format(0, 1, 2, 3) + rules.format(3, 2)
    row = "[[slave]]\nposition = 1\nname = 'new'\nvendor = 2\nproduct = 9\n"
    found, moved = compared(tmp_path, before, row + SLAVES.format(0, 2, 3, 4) + rules.format(4, 3))
    table = {"position": 1, "name": "new", "vendor": 2, "product": 9}
    assert found == {"slave[new]": (None, table)}
    assert moved == [(2, 1, 2), (3, 2, 3), (4, 3, 4)]
    found, moved = compared(tmp_path, row + SLAVES.format(0, 2, 3, 4) + rules.format(4, 3), before)
    assert found == {"slave[new]": (table, None)}
    assert moved == [(1, 2, 1), (2, 3, 2), (3, 4, 3)]


def test_a_slave_that_stands_elsewhere_is_told(tmp_path: Path) -> None:
    swapped = NAMED.replace("position = 0", "position = 7").replace("= 1\nname", "= 0\nname")
    found, moved = compared(tmp_path, NAMED, swapped.replace("position = 7", "position = 1"))
    assert found == {"slave[feed].position": (0, 1), "slave[press].position": (1, 0)}
    assert not moved
    renamed = NAMED.replace('"feed"', '"intake"')
    assert compared(tmp_path, NAMED, renamed)[0] == {"slave[feed].name": ("feed", "intake")}


def test_a_slave_without_a_place_is_found_by_its_mark(tmp_path: Path) -> None:
    tool = "[[slave]]\nalias = {}\nvendor = 2\nproduct = 3\nname = '{}'\noptional = true\n"
    before = SLAVES.format(0, 1, 2, 3) + tool.format(7, "tool")
    after = tool.format(8, "other") + tool.format(7, "gripper") + SLAVES.format(0, 1, 2, 3)
    found, moved = compared(tmp_path, before, after)
    assert [*found] == ["slave[tool].name", "slave[other]"]
    assert not moved
