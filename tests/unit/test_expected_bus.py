"""The bus that the configuration expects, compared with the slaves that are found."""

from __future__ import annotations

import random
import tomllib
from typing import Any

import pytest
from bus_strategies import buses
from hypothesis import given
from hypothesis import strategies as st

from conftest import names
from ecatd.config import Config, read_config
from ecatd.config.expected_bus import Comparison, compare
from ecatd.config.writer import write_config
from ecatd.description.bus import Bus, Slave

VENDOR = 2


def bus(*products: int, aliases: dict[int, int] | None = None) -> list[Slave]:
    """Slaves with these product codes; the revision is always 5, the serial number the product."""
    return [
        Slave(n, f"P{product}", VENDOR, product, 5, serial=product, alias=(aliases or {}).get(n, 0))
        for n, product in enumerate(products)
    ]


def expect(*products: int, unlisted: bool = False, policy: str = "strict", **more: Any) -> Config:
    """Slaves with these product codes; 0: any slave. `n2={…}`: more keys of slave 2."""
    rows = []
    for n, product in enumerate(products):
        identity = {"vendor": VENDOR, "product": product} if product else {}
        rows.append({"position": n, "name": f"n{n}", **identity, **more.pop(f"n{n}", {})})
    expected = {"unlisted": unlisted, "policy": policy}
    return read_config({"slave": rows, "expected": expected, **more})


def kinds(found: Comparison) -> list[tuple[str, tuple[int, ...], tuple[int, ...]]]:
    return [(item.kind, item.expected, item.found) for item in found.differences]


def test_slaves_that_are_known_are_not_the_extra_ones() -> None:
    config, found = expect(1, 2, 2, 3), bus(1, 2, 2, 2, 2, 3)
    assert kinds(compare(config, found)) == [("extra", (), (3,)), ("extra", (), (4,))]
    for first, second, extra in ((1, 4, (2, 3)), (3, 4, (1, 2)), (2, 4, (1, 3))):
        compared = compare(config, found, known={0: 0, first: 1, second: 2, 5: 3})
        assert kinds(compared) == [("extra", (), (n,)) for n in extra]
        assert compared.places == {0: 0, 1: first, 2: second, 3: 5}
    # What is known decides only between equal slaves.
    compared = compare(config, bus(1, 3, 2, 2), known={0: 0, 1: 1, 2: 2})
    assert kinds(compared) == kinds(compare(config, bus(1, 3, 2, 2)))


@pytest.mark.parametrize(
    ("found", "differences", "places"),
    [
        ([1, 2, 3, 3, 4], [], [0, 1, 2, 3, 4]),
        ([1, 9, 2, 3, 3, 4], [("extra", (), (1,))], [0, 2, 3, 4, 5]),
        ([9, 1, 2, 3, 3, 4], [("extra", (), (0,))], [1, 2, 3, 4, 5]),
        ([1, 2, 3, 3, 4, 9], [("extra", (), (5,))], [0, 1, 2, 3, 4]),
        ([1, 2, 3, 4], [("missing", (3,), ())], [0, 1, 2, None, 3]),
        ([2, 3, 3, 4], [("missing", (0,), ())], [None, 0, 1, 2, 3]),
        ([1, 2], [("missing", (2, 3, 4), ())], [0, 1, None, None, None]),
        ([], [("missing", (0, 1, 2, 3, 4), ())], [None] * 5),
        ([1, 2, 9, 3, 4], [("other device", (2,), (2,))], [0, 1, 2, 3, 4]),
        ([4, 2, 3, 3, 1], [("wrong place", (0, 4), (0, 4))], [4, 1, 2, 3, 0]),
        ([1, 3, 3, 4, 2], [("wrong place", (1,), (4,))], [0, 4, 1, 2, 3]),
        (
            [1, 9, 2, 3, 4],
            [("extra", (), (1,)), ("missing", (3,), ())],
            [0, 2, 3, None, 4],
        ),
        (
            [2, 1, 3, 4, 3],
            [("wrong place", (0,), (1,)), ("wrong place", (2,), (4,))],
            [1, 0, 4, 2, 3],
        ),
        (
            [2, 1, 3, 9, 4],
            [("wrong place", (0,), (1,)), ("other device", (3,), (3,))],
            [1, 0, 2, 3, 4],
        ),
        (
            [4, 2, 3, 3, 1, 9],
            [("wrong place", (0, 4), (0, 4)), ("extra", (), (5,))],
            [4, 1, 2, 3, 0],
        ),
    ],
)
def test_each_mistake_is_one_difference(
    found: list[int], differences: list[Any], places: list[int | None]
) -> None:
    comparison = compare(expect(1, 2, 3, 3, 4), bus(*found))
    assert kinds(comparison) == differences
    assert [comparison.places.get(n) for n in range(5)] == places
    assert all(item.strict for item in comparison.differences)
    assert set(comparison.unexpected) == {n for _, _, found in differences for n in found}


def test_slaves_that_are_gone_are_missing_and_keep_their_places() -> None:
    config = expect(1, 2, 3, 4, n2={"optional": True})
    comparison = compare(config, bus(1, 2, 3, 4), gone={1, 2})
    assert kinds(comparison) == [("missing", (1,), ())]
    assert [item.position for item in comparison.absent] == [2]
    assert comparison.places == {0: 0, 1: 1, 2: 2, 3: 3}
    tool = {"alias": 7, "vendor": VENDOR, "product": 2, "optional": True}
    marked = read_config({"slave": [tool]})
    comparison = compare(marked, bus(1, 2, aliases={1: 7}), gone={1})
    assert not comparison.differences
    assert list(comparison.places.values()) == [1]


@pytest.mark.parametrize(
    ("found", "tokens"),
    [
        ([1, 9, 2, 3], ["slave 1 (P9)", "extra", "product 0x00000009"]),
        ([1, 3], ["n1 (EL1018)", "missing", "slave 1", "behind slave 0", "n0"]),
        ([3], ["2 slaves are missing", "0 to 1", "first on the bus", "n0", "n1 (EL1018)"]),
        ([1, 9, 3], ["slave 1 (P9)", "n1 (EL1018)", "0x00000009", "0x00000002"]),
        ([3, 2, 1], ["n0", "n2", "changed places", "2", "0"]),
        ([1, 3, 2], ["slave 1", "slave 2", "move it"]),
    ],
)
def test_a_difference_says_what_and_where(found: list[int], tokens: list[str]) -> None:
    config = expect(1, 2, 3, n1={"type": "EL1018"})
    (difference,) = compare(config, bus(*found)).differences
    names(difference.text, *tokens)


@pytest.mark.parametrize(
    ("wanted", "kind"),
    [
        ({"revision": 5}, ""),
        ({"revision": 4}, "other revision"),
        ({"revision": 6}, "other revision"),
        ({"revision_min": 5}, ""),
        ({"revision_min": 4}, ""),
        ({"revision_min": 6}, "other revision"),
        ({"serial": 2}, ""),
        ({"serial": 3}, "other serial number"),
    ],
)
def test_revision_and_serial_number(wanted: dict[str, int], kind: str) -> None:
    found = compare(expect(1, 2, n1=wanted), bus(1, 2))
    assert kinds(found) == ([(kind, (1,), (1,))] if kind else [])


def test_slaves_without_a_table_may_be_used() -> None:
    config = expect(1, 0, 3, unlisted=True)
    assert not compare(config, bus(1, 77, 3)).differences
    assert not compare(config, bus(1, 78, 3, 4, 5)).differences
    assert kinds(compare(config, bus(1, 3))) == [("missing", (1,), ())]
    assert kinds(compare(config, bus(1, 77, 78, 3, 4))) in (
        [("extra", (), (1,))],
        [("extra", (), (2,))],
    )


def test_without_identities_everything_is_as_it_was() -> None:
    config = read_config(
        {"slave": [{"position": 1}], "signal": [{"slave": 3, "entry": "0x6000:01"}]}
    )
    found = compare(config, bus(1, 2, 3))
    assert found == Comparison({1: 1, 3: 3}, [])
    assert config.moved(found.places) == config


def test_an_alias_finds_a_slave_wherever_it_stands() -> None:
    rows = [
        {"position": 0, "vendor": VENDOR, "product": 1},
        {"alias": 7, "name": "spindle", "vendor": VENDOR, "product": 5},
        {"position": 1, "vendor": VENDOR, "product": 2},
    ]
    config = read_config({"slave": rows, "outputs": {"safe": [{"slave": "spindle"}]}})
    for found, at in (([5, 1, 2], 0), ([1, 5, 2], 1), ([1, 2, 5], 2)):
        comparison = compare(config, bus(*found, aliases={at: 7}))
        assert not comparison.differences
        moved = config.moved(comparison.places)
        assert moved.outputs.safe[0].slave == at
        assert moved.settings_of(at).name == "spindle"
    without = compare(config, bus(1, 5, 2))
    assert [kind for kind, _, _ in kinds(without)] == ["other station alias"]
    names(without.differences[0].text, "slave 1 (P5)", "no station alias", "spindle", "7")
    assert [kind for kind, _, _ in kinds(compare(config, bus(1, 2)))] == ["missing"]
    twice = compare(config, bus(1, 5, 2, aliases={0: 7, 1: 7}))
    (clash,) = [item for item in twice.differences if len(item.found) == 2]
    names(clash.text, "slaves 0, 1", "station alias", "7", "spindle")
    other = compare(config, bus(1, 6, 2, aliases={1: 7}))
    assert [item.kind for item in other.differences] == ["other device"]


@pytest.mark.parametrize(
    ("found", "places", "absent"),
    [
        ([1, 2, 3, 2, 4], [0, 1, 2, 3, 4], []),
        ([1, 2, 4], [0, None, None, 1, 2], [1, 2]),  # the slave that must be there is there
        ([1, 2, 2, 4], [0, 1, None, 2, 3], [2]),
        ([1, 3, 2, 4], [0, None, 1, 2, 3], [1]),
    ],
)
def test_optional_slaves_may_be_absent(
    found: list[int], places: list[int | None], absent: list[int]
) -> None:
    wanted = expect(1, 2, 3, 2, 4, n1={"optional": True}, n2={"group": "tool"})
    comparison = compare(wanted, bus(*found))
    assert kinds(comparison) == []
    assert [comparison.places.get(n) for n in range(5)] == places
    assert [slave.position for slave in comparison.absent] == absent
    others = compare(wanted, bus(*found[:-1]))
    assert kinds(others) == [("missing", (4,), ())]


def test_a_group_stands_behind_its_first_slave() -> None:
    rows = [
        {"position": 0, "vendor": VENDOR, "product": 1},
        {"name": "a", "alias": 7, "group": "tool", "vendor": VENDOR, "product": 2},
        {"name": "b", "group": "tool", "vendor": VENDOR, "product": 3},
        {"position": 1, "vendor": VENDOR, "product": 3},
    ]
    wanted = read_config({"slave": rows, "expected": {"unlisted": False}})
    a, b = (slave.position for slave in wanted.slave[1:3])
    there = compare(wanted, bus(1, 2, 3, 3, aliases={1: 7}))
    assert (kinds(there), there.places) == ([], {0: 0, a: 1, b: 2, 1: 3})
    behind = compare(wanted, bus(1, 3, 2, 3, aliases={2: 7}))
    assert (kinds(behind), behind.places) == ([], {0: 0, 1: 1, a: 2, b: 3})
    away = compare(wanted, bus(1, 3))
    assert (kinds(away), away.places) == ([], {0: 0, 1: 1})
    assert [slave.name for slave in away.absent] == ["a", "b"]
    other = compare(wanted, bus(1, 3, 2, 4, aliases={2: 7}))
    assert kinds(other) == [("other device", (b,), (3,))]
    assert read_config(wanted.to_dict()) == wanted


def test_a_group_of_which_something_is_missing_takes_no_slave_behind_it() -> None:
    rows = [
        {"position": 0, "vendor": VENDOR, "product": 1},
        {"name": "a", "alias": 7, "group": "long", "vendor": VENDOR, "product": 2},
        {"name": "b", "group": "long", "vendor": VENDOR, "product": 3},
        {"name": "c", "group": "long", "vendor": VENDOR, "product": 5},
        {"name": "d", "alias": 8, "group": "short", "vendor": VENDOR, "product": 2},
        {"position": 1, "vendor": VENDOR, "product": 4},
    ]
    wanted = read_config({"slave": rows, "expected": {"unlisted": False}})
    a, b, c, d = (slave.position for slave in wanted.slave[1:5])
    short = compare(wanted, bus(1, 2, 3, 4, aliases={1: 7}))
    assert (kinds(short), short.places) == ([], {0: 0, a: 1, b: 2, 1: 3})
    assert [slave.name for slave in short.absent] == ["c", "d"]
    other = compare(wanted, bus(1, 2, 3, 6, 4, aliases={1: 7}))
    assert kinds(other) == [("other device", (c,), (3,))]
    # The aliases are exchanged: the third slave of the long group stands behind the short one.
    exchanged = compare(wanted, bus(1, 2, 5, 2, 3, 4, aliases={1: 8, 3: 7}))
    assert kinds(exchanged) == [("wrong place", (c,), (2,))]
    names(exchanged.differences[0].text, "behind a (", "group long", "slave 2")
    assert (exchanged.places[1], exchanged.places[d]) == (5, 1)


def test_an_extra_slave_may_be_in_the_place_of_an_optional_one() -> None:
    wanted = expect(1, 2, 3, n1={"optional": True, "name": "gripper"})
    (there,) = compare(wanted, bus(1, 9, 3)).differences
    assert (there.kind, there.found) == ("extra", (1,))
    names(there.text, "slave 1 (P9)", "gripper", "absent", "in its place")
    (elsewhere,) = compare(wanted, bus(1, 2, 9, 3)).differences
    assert "absent" not in elsewhere.text


def test_groups_with_the_same_alias_are_one_difference() -> None:
    rows = [
        {"name": "a", "alias": 7, "group": "tool", "vendor": VENDOR, "product": 2},
        {"name": "b", "group": "tool", "vendor": VENDOR, "product": 3},
        {"position": 0, "vendor": VENDOR, "product": 1},
    ]
    wanted = read_config({"slave": rows, "expected": {"unlisted": False}})
    twice = compare(wanted, bus(1, 2, 3, 2, 3, aliases={1: 7, 3: 7}))
    ((kind, _, found),) = kinds(twice)
    assert (kind, found) == ("other device", (1, 2, 3, 4))
    names(twice.differences[0].text, "slaves 1, 3", "station alias", "7")


def test_a_slave_that_tells_another_identification_is_no_extra_one() -> None:
    tool = {"group": "tool", "vendor": VENDOR}
    rows = [
        {"position": 0, "vendor": VENDOR, "product": 1},
        {"name": "head", "identification": 42, "product": 2, **tool},
        {"name": "jaw", "product": 3, **tool},
        {"position": 1, "vendor": VENDOR, "product": 4},
    ]
    wanted = read_config({"slave": rows, "expected": {"unlisted": False}})
    head, jaw = (slave.position for slave in wanted.slave[1:3])
    slaves = bus(1, 4, 2, 3)
    for told, tokens in ((41, ["41", "selector"]), (0, ["no identification", "selector"])):
        slaves[2].identification = told
        found = compare(wanted, slaves)
        assert kinds(found) == [("other identification", (head, jaw), (2, 3))]
        names(found.differences[0].text, "slave 2 (P2)", "head", "42", *tokens)
        assert [slave.name for slave in found.absent] == ["head", "jaw"]
    del rows[1]["group"], rows[2]
    alone = read_config({"slave": rows, "expected": {"unlisted": False}})
    assert kinds(compare(alone, slaves[:3])) == [("other identification", (head,), (2,))]


def test_groups_that_lack_a_slave_leave_those_of_others() -> None:
    rows = [{"position": 0, "vendor": VENDOR, "product": 1}]
    for number in (1, 2):
        tool = {"group": f"t{number}", "vendor": VENDOR}
        rows.append({"name": f"head{number}", "identification": number, "product": 2, **tool})
        rows.append({"name": f"jaw{number}", "product": 3, **tool})
    wanted = read_config({"slave": rows, "expected": {"unlisted": False}})
    _, head1, jaw1, head2, jaw2 = (slave.position for slave in wanted.slave)
    slaves = bus(1, 2, 2, 3, 3)
    slaves[1].identification, slaves[2].identification = 1, 2
    found = compare(wanted, slaves)
    assert kinds(found) == [("wrong place", (jaw1,), (4,))]
    names(found.differences[0].text, "jaw1", "behind head1", "t1", "slave 4")
    assert found.places == {0: 0, head1: 1, head2: 2, jaw2: 3, jaw1: 4}
    assert found.absent == []
    away = compare(wanted, slaves[:4])
    assert (kinds(away), [slave.name for slave in away.absent]) == ([], ["jaw1"])


def test_the_tables_follow_their_slaves() -> None:
    config = expect(
        1,
        2,
        3,
        n2={"startup": [{"object": "0x6060:00", "hex": "08"}]},
        domain=[{"slaves": [0]}, {"name": "slow", "divider": 4, "slaves": ["n1", "n2"]}],
        dc={"reference": "n0", "slave": [{"slave": "n2"}]},
        outputs={"safe": [{"slave": "n1", "value": "hold"}]},
        signal=[{"slave": "n2", "entry": "0x6000:01", "name": "speed"}],
    )
    assert read_config(config.to_dict()) == config
    moved = config.moved(compare(config, bus(9, 1, 3)).places)
    assert [item.position for item in moved.slave] == [1, 2]
    assert moved.settings_of(2).startup[0].object == "0x6060:00"
    assert [domain.slaves for domain in moved.domain] == [[1], [2]]
    assert (moved.dc.reference, [item.slave for item in moved.dc.slave]) == (1, [2])
    assert moved.outputs.safe == []  # that of n1, which is missing
    assert [item.slave for item in moved.signal] == [2]


def test_a_slave_may_have_a_policy_of_its_own() -> None:
    config = expect(1, 2, 3, n1={"policy": "tolerant"})
    assert [item.strict for item in compare(config, bus(1, 3)).differences] == [False]
    assert [item.strict for item in compare(config, bus(2, 3)).differences] == [True]
    config = expect(1, 2, 3, policy="tolerant", n1={"policy": "strict"})
    assert [item.strict for item in compare(config, bus(1)).differences] == [True, False]
    assert [item.strict for item in compare(config, bus(1, 2, 9, 3)).differences] == [False]


@given(
    st.lists(st.integers(1, 4), max_size=12), st.integers(0, 3), st.randoms(use_true_random=False)
)
def test_a_few_changes_are_a_few_differences(
    products: list[int], changes: int, rng: random.Random
) -> None:
    found = list(products)
    for _ in range(changes):
        at = rng.randrange(len(found) + 1)
        if rng.random() < 0.5 or at == len(found):
            found.insert(at, rng.randint(1, 5))
        elif rng.random() < 0.5:
            del found[at]
        else:
            found[at] = rng.randint(1, 5)
    comparison = compare(expect(*products), bus(*found))
    assert len(comparison.differences) <= 2 * changes
    if products == found:
        assert not comparison.differences
    places = comparison.places
    assert len(set(places.values())) == len(places)
    missing = {n for item in comparison.differences if not item.found for n in item.expected}
    assert missing == set(range(len(products))) - set(places)
    extra = {n for item in comparison.differences if not item.expected for n in item.found}
    assert extra == set(range(len(found))) - set(places.values())
    assert not {products[n] for n in missing} & {found[n] for n in extra}


@pytest.mark.long
@given(buses)
def test_the_configuration_of_any_bus_expects_it(bus: Bus) -> None:
    text = write_config(Config(), bus, "1.0")
    config = read_config(tomllib.loads(text))
    comparison = compare(config, bus.slaves)
    assert not comparison.differences
    assert len({slave.name for slave in config.slave}) == len(bus.slaves)
    assert write_config(config.moved(comparison.places), bus, "1.0") == text


@pytest.mark.long
def test_a_long_bus_takes_no_time_where_it_is_as_expected() -> None:
    products = [1 + n % 7 for n in range(5000)]
    assert not compare(expect(*products), bus(*products)).differences
