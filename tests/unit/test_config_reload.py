"""What of a new configuration can be used without a restart, and where its keys are written."""

import tomllib
from pathlib import Path

import pytest

from ecatd.config import Config, load_config, read_config
from ecatd.config.origins import Origin, find_origins
from ecatd.config.reload import reload

BEFORE = """
cycle_time_us = 1000
[[slave]]
position = 0
name = "press"
vendor = 2
product = 3
[[signal]]
slave = "press"
entry = "0x7000:01"
unit = "V"
scale = 0.5
minimum = -1
maximum = 1
[[signal]]
slave = 3
entry = "0x7000:01"
name = "lamp"
"""


def config(text: str) -> Config:
    return read_config(tomllib.loads(text))


@pytest.mark.parametrize(
    ("change", "used", "later"),
    [
        (("maximum = 1", "maximum = 2"), ["signal[press 0x7000:01].maximum"], []),
        (("maximum = 1", ""), ["signal[press 0x7000:01].maximum"], []),
        (
            ('unit = "V"\nscale = 0.5\nminimum = -1', 'unit = "A"\nminimum = -3'),
            [],
            [f"signal[press 0x7000:01].{key}" for key in ("unit", "scale", "minimum")],
        ),
        (
            ('name = "lamp"', 'name = "light"\nminimum = 1'),
            ["signal[3 0x7000:01].minimum"],
            ["signal[3 0x7000:01].name"],
        ),
        (
            ("[[slave]]", "[[signal]]\nslave = 4\nentry = '0x1:0'\nmaximum = 7\n[[slave]]"),
            ["signal[4 0x0001:00]"],
            [],
        ),
        (
            (
                "[[slave]]",
                "[[signal]]\nslave = 4\nentry = '0x1:0'\nmaximum = 7\nname = 'x'\n[[slave]]",
            ),
            ["signal[4 0x0001:00]"],
            ["signal[4 0x0001:00].name"],
        ),
        (
            ("[[slave]]", "[[signal]]\nslave = 4\nentry = '0x1:0'\nname = 'x'\n[[slave]]"),
            [],
            ["signal[4 0x0001:00]"],
        ),
        (
            (
                "[[slave]]",
                "[[signal]]\nslave = 4\nentry = '0x1:0'\nmaximum = 7\nscale = 2\n[[slave]]",
            ),
            [],
            ["signal[4 0x0001:00]"],
        ),
        # Another slave is expected, so the limit may be about another one, too.
        (
            ('product = 3\n[[signal]]\nslave = "press"', "product = 4\n[[signal]]\nslave = 0"),
            [],
            ["slave[press].product"],
        ),
        (
            ("position = 0", "position = 1"),
            [],
            ["slave[press].position"],
        ),
        (("cycle_time_us = 1000", "[mailbox]\nshare = 0.1"), ["mailbox.share"], []),
        (("cycle_time_us = 1000", "[outputs]\nwkc_limit = 3"), ["outputs.wkc_limit"], []),
        (
            ("cycle_time_us = 1000", "[flight_recorder]\ndisk_mb = 3\nmemory_mb = 1"),
            ["flight_recorder.disk_mb"],
            ["flight_recorder.memory_mb"],
        ),
    ],
)
def test_what_is_used_at_once(change: tuple[str, str], used: list[str], later: list[str]) -> None:
    before, wanted = config(BEFORE), config(BEFORE.replace(*change))
    found = reload(before, wanted)
    assert (found.used, found.later) == (used, later)
    again = reload(found.config, wanted)
    assert (again.used, again.later) == ([], later)
    assert reload(wanted, wanted).config.to_dict() == wanted.to_dict()


def test_limits_wait_for_a_restart_with_the_slaves() -> None:
    moved = BEFORE.replace("product = 3", "product = 4").replace("maximum = 1", "maximum = 2")
    found = reload(config(BEFORE), config(moved))
    assert found.used == []
    assert found.later == ["slave[press].product", "signal[press 0x7000:01].maximum"]


def test_a_table_that_is_gone_takes_its_limits_with_it() -> None:
    with_limit = BEFORE + "minimum = 1\n"
    found = reload(config(with_limit), config(with_limit.partition("[[signal]]\nslave = 3")[0]))
    assert found.used == ["signal[3 0x7000:01].minimum"]
    assert found.later == ["signal[3 0x7000:01]"]


def test_keys_in_force_are_named_where_they_are_written(tmp_path: Path) -> None:
    file = tmp_path / "w.toml"
    file.write_text(BEFORE)
    before = load_config(file)
    old = find_origins(before)
    later = '[[signal]]\nslave = 5\nentry = "0x0001:00"\nname = "later"\n'
    limited = '[[signal]]\nslave = 4\nentry = "0x0001:00"\nmaximum = 7\n'
    first, _, second = BEFORE.partition('[[signal]]\nslave = "press"')
    kept = f'[[signal]]\nslave = "press"{second}'.partition("[[signal]]\nslave = 3")[0]
    file.write_text(first + later + limited + kept)
    now = load_config(file)
    found = reload(before, now)
    origins = found.origins(old, find_origins(now))
    lines = file.read_text().splitlines()
    for number, rule in enumerate(found.config.signal):
        where = origins[f"signal[{number}].entry"]
        if rule.slave == 3:  # the file does not have it any more
            assert where == Origin(str(file), old["signal[1].entry"].line, changed=True)
            assert str(where).endswith(f":{where.line} (before it was changed)")
        else:
            assert (where.file, where.changed) == (str(file), False)
            assert lines[where.line - 1] == f'entry = "{rule.entry}"'
    assert [rule.slave for rule in found.config.signal] == [0, 3, 4]
    assert origins["slave[0].name"] == Origin(str(file), 5)


def test_what_waits_for_a_restart_has_its_earlier_place(tmp_path: Path) -> None:
    file = tmp_path / "w.toml"
    file.write_text("cycle_time_us = 2000\n[recovery]\nretry_s = 5\n[mailbox]\nshare = 0.5\n")
    before = load_config(file)
    origins = {**find_origins(before), "bus": Origin()}
    for text in ("[recovery]\nretry_s = 7\n", "[recovery]\nretry_s = 8\n", ""):
        file.write_text(text)
        wanted = load_config(file)
        found = reload(before, wanted)
        origins = found.origins(origins, find_origins(wanted))
        assert origins["cycle_time_us"] == Origin(str(file), 1, changed=True)
        assert origins.get("recovery.retry_s") == (Origin(str(file), 2) if text else None)
        assert "mailbox.share" not in origins, "it has its default again"
        before = found.config
