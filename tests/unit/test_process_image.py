"""Domains and datagrams: where each slave has its bytes, and what the working counters must be."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from conftest import naming
from ecatd.base.errors import ConfigError, StateError
from ecatd.config import DomainConfig
from ecatd.config.resolve.resolved import assign_domains
from ecatd.description.bus import Bus, Domain, Slave
from ecatd.etg.pdo import Entry, Pdo
from ecatd.master.engine.process_image import (
    DOMAIN_DATAGRAM_MAX,
    LRD,
    LRW,
    LWR,
    WINDOW,
    DomainImage,
    Image,
    lay_out,
)
from ecatd.shm.contract import MAX_GROUPS


def pdos(index: int, bits: int) -> list[Pdo]:
    sizes = [64] * (bits // 64) + [bits % 64] * (bits % 64 > 0)
    entries = [Entry(index, n, "", 0, size) for n, size in enumerate(sizes, 1)]
    return [Pdo(index, "", 2, entries)] if bits else []


def slave(position: int, out_bits: int, in_bits: int, domain: int = 0) -> Slave:
    made = Slave(position, f"S{position}", 2, 7, 1, domain=domain)
    made.outputs, made.inputs = pdos(0x7000, out_bits), pdos(0x6000, in_bits)
    return made


def bus(*slaves: Slave) -> Bus:
    return Bus("b", 1000, list(slaves))


def rows(domain: DomainImage) -> list[tuple[int, int, int, int]]:
    return [(d.command, d.offset, d.length, d.wkc_expected) for d in domain.datagrams]


def test_every_slave_has_whole_bytes() -> None:
    made = bus(slave(0, 4, 1), slave(1, 4, 12), slave(2, 0, 0))
    domain = lay_out(made, set()).domains[0]
    assert [s.output_offset for s in made.slaves[:2]] == [0, 1]
    assert [s.input_offset for s in made.slaves[:2]] == [2, 3]
    assert (domain.output_bytes, domain.input_bytes) == (2, 3)
    assert rows(domain) == [(LRW, 0, 5, 6)]


def test_only_a_slave_without_lrw_needs_two_datagrams() -> None:
    made = bus(slave(0, 8, 8), slave(1, 16, 24), slave(2, 32, 0))
    domain = lay_out(made, {1}).domains[0]
    assert rows(domain) == [(LWR, 0, 2, 1), (LRW, 2, 6, 5), (LRD, 8, 3, 1)]
    assert [s.output_offset for s in made.slaves] == [2, 0, 3]
    assert [s.input_offset for s in made.slaves[:2]] == [7, 8]


def test_large_images_are_cut_at_slave_boundaries() -> None:
    made = bus(*(slave(n, 512, 512) for n in range(40)))
    domain = lay_out(made, set()).domains[0]
    assert sum(d.length for d in domain.datagrams) == 40 * 128
    assert [d.length for d in domain.datagrams] == [22 * 64, 22 * 64, 22 * 64, 14 * 64]
    # A slave counts once for reading and twice for writing, in whichever datagram its bytes are.
    assert domain.wkc_expected == 40 * 3


def pieces(domain: DomainImage) -> list[tuple[int, int, int, int, bool]]:
    return [(d.command, d.offset, d.length, d.split, d.closes) for d in domain.datagrams]


def test_more_than_a_datagram_of_one_slave_is_split() -> None:
    whole = lay_out(bus(slave(0, 8 * DOMAIN_DATAGRAM_MAX, 8 * DOMAIN_DATAGRAM_MAX)), set())
    assert [row[3:] for row in pieces(whole.domains[0])] == [(0, False)] * 2
    made = lay_out(bus(slave(0, 8, 8), slave(1, 8, 8 * 1453), slave(2, 8, 8)), set()).domains[0]
    assert pieces(made) == [
        (LRW, 0, 4, 0, False),
        (LRW, 4, 1452, 1, False),
        (LRW, 1456, 1, 1, False),
        (LRW, 1457, 1, 0, False),
    ]
    assert [d.wkc_expected for d in made.datagrams] == [3 * 2 + 1, 1, 1, 1]
    made = lay_out(bus(slave(0, 8, 8), slave(1, 8 * 3000, 8 * 1500)), {1}).domains[0]
    assert pieces(made) == [
        (LWR, 0, 1452, 1, False),
        (LWR, 1452, 1452, 1, False),
        (LWR, 2904, 96, 1, True),
        (LRW, 3000, 2, 0, False),
        (LRD, 3002, 1452, 2, False),
        (LRD, 4454, 48, 2, False),
    ]


def test_sync_managers_that_fit_stay_whole() -> None:
    made = Slave(0, "S0", 2, 7, 1)
    for number, size in enumerate((100, 1400, 2000, 60, 1000, 1452), 2):
        made.outputs += [replace(pdo, sync_manager=number) for pdo in pdos(0x7000, 8 * size)]
    domain = lay_out(bus(made), set()).domains[0]
    found = [(d.length, d.closes) for d in domain.datagrams]
    assert found == [
        (100, False),
        (1400, False),
        (1452, False),
        (548, True),
        (1060, False),
        (1452, False),
    ]
    assert domain.wkc_expected == 2 * len(found)


def test_more_groups_than_a_domain_has_bits_for_are_refused() -> None:
    made = bus(*(slave(n, 8, 0) for n in range(MAX_GROUPS + 1)))
    for item in made.slaves:
        item.group = f"slave {item.position}"
    with pytest.raises(StateError, match=naming("domain 0", MAX_GROUPS + 1, MAX_GROUPS)):
        lay_out(made, set())
    made.slaves[0].group = "slave 1"
    assert len(lay_out(made, set()).domains[0].datagrams) == MAX_GROUPS


def test_slaves_are_where_the_configuration_puts_them() -> None:
    made = bus(*(slave(n, 8, 8) for n in range(5)))
    assign_domains(
        made, [DomainConfig("fast"), DomainConfig("", 4, 3, [3]), DomainConfig("z", 9, 0, [1])]
    )
    image = lay_out(made, set())
    assert [s.domain for s in made.slaves] == [0, 2, 0, 1, 0]
    assert made.domains == [Domain("fast", 1), Domain("", 4, 3), Domain("z", 9)]
    assert [(d.name, d.divider) for d in image.domains] == [("fast", 1), ("", 4), ("z", 9)]
    assert [d.phase for d in image.domains] == [0, 3, 0]
    assert [d.output_base for d in image.domains] == [0, 3, 4]
    assert image.output_bytes == 5
    assert [d.address for d in image.domains] == [WINDOW, 2 * WINDOW, 3 * WINDOW]


def test_without_configuration_all_slaves_are_in_domain_0() -> None:
    made = bus(slave(0, 8, 8), slave(1, 8, 8, domain=1))
    assign_domains(made, [])
    assert [s.domain for s in made.slaves] == [0, 0]
    assert made.domains == [Domain("", 1)]
    assert len(lay_out(made, set()).domains) == 1
    assert len(lay_out(bus(slave(0, 0, 0)), set()).domains) == 1


def test_domains_that_do_not_fit_the_bus_are_refused() -> None:
    made = bus(slave(0, 8, 8), slave(1, 0, 0), slave(2, 8, 8))
    with pytest.raises(ConfigError, match=naming("domain 1", "nothing")):
        assign_domains(made, [DomainConfig(), DomainConfig("", 4, 0, [1])])
    with pytest.raises(ConfigError, match=naming("domain 0", "nothing")):
        assign_domains(made, [DomainConfig(), DomainConfig("", 4, 0, [0, 1, 2])])
    assign_domains(bus(slave(0, 0, 0)), [DomainConfig("all")])


@st.composite
def buses(draw: st.DrawFn) -> tuple[Bus, set[int]]:
    """Any mix of slaves: sizes from nothing to a datagram, with and without LRW, in domains."""
    bits = st.one_of(
        st.just(0), st.integers(1, 100), st.integers(1, 8 * DOMAIN_DATAGRAM_MAX), st.just(8 * 726)
    )
    count = draw(st.integers(1, 30))
    domains = draw(st.integers(1, 16))
    made = bus(
        *(slave(n, draw(bits), draw(bits), draw(st.integers(0, domains - 1))) for n in range(count))
    )
    for item in made.slaves:
        item.group = draw(st.sampled_from(("", "", "tool", "station")))
    return made, draw(st.sets(st.integers(0, count - 1)))


def counter(bus: Bus, domain: DomainImage, command: int, first: int, last: int) -> int:
    """The working counter as slaves make it: ETG.1000.4, by FMMUs that a datagram touches."""
    total = 0
    for item in bus.slaves:
        if item.domain != domain.number:
            continue
        for offset, length, writing in (
            (item.output_offset, item.output_bytes, True),
            (item.input_offset, item.input_bytes, False),
        ):
            if length and offset <= last and first < offset + length:
                if writing and command in (LWR, LRW):
                    total += 2 if command == LRW else 1
                elif not writing and command in (LRD, LRW):
                    total += 1
    return total


@given(buses())
def test_counters_are_those_that_slaves_make(case: tuple[Bus, set[int]]) -> None:
    made, without_lrw = case
    image = lay_out(made, without_lrw)
    for domain in image.domains:
        for d in domain.datagrams:
            assert d.wkc_expected == counter(
                made, domain, d.command, d.offset, d.offset + d.length - 1
            )


@given(buses())
def test_every_byte_is_exchanged_once_and_the_right_way(case: tuple[Bus, set[int]]) -> None:
    made, without_lrw = case
    image = lay_out(made, without_lrw)
    check_sizes(made, image)
    for domain in image.domains:
        carried = dict.fromkeys(range(domain.output_bytes + domain.input_bytes), 0)
        for d in domain.datagrams:
            assert 0 < d.length <= DOMAIN_DATAGRAM_MAX
            assert d.command != LWR or d.offset + d.length <= domain.output_bytes
            assert d.command != LRD or d.offset >= domain.output_bytes
            for byte in range(d.offset, d.offset + d.length):
                assert carried[byte] == 0
                carried[byte] = d.command
            groups = {
                s.group
                for s in made.slaves
                if s.domain == domain.number
                for first, count in (
                    (s.output_offset, s.output_bytes),
                    (s.input_offset, s.input_bytes),
                )
                if count and d.offset <= first < d.offset + d.length
            }
            assert groups == {domain.groups[d.group] if d.group >= 0 else ""}
        assert 0 not in carried.values()
        owned: set[int] = set()
        for item in (item for item in made.slaves if item.domain == domain.number):
            outputs = range(item.output_offset, item.output_offset + item.output_bytes)
            inputs = range(item.input_offset, item.input_offset + item.input_bytes)
            assert not outputs or outputs[-1] < domain.output_bytes
            assert not inputs or inputs[0] >= domain.output_bytes
            assert owned.isdisjoint(outputs)
            assert owned.isdisjoint(inputs)
            owned.update(outputs, inputs)
            split = item.position in without_lrw or item.group
            assert {carried[byte] for byte in outputs} <= {LWR if split else LRW}
            assert {carried[byte] for byte in inputs} <= {LRD if split else LRW}
            # Outputs of a slave, and its inputs, travel whole.
            for part in (outputs, inputs):
                assert not part or any(
                    d.offset <= part[0] and part[-1] < d.offset + d.length for d in domain.datagrams
                )
        assert owned == set(carried)


def check_sizes(made: Bus, image: Image) -> None:
    assert sum(d.output_bytes for d in image.domains) == sum(s.output_bytes for s in made.slaves)
    assert sum(d.input_bytes for d in image.domains) == sum(s.input_bytes for s in made.slaves)
    base = 0
    for domain in image.domains:
        assert domain.output_base == base
        assert domain.output_bytes + domain.input_bytes <= WINDOW
        base += domain.output_bytes
    assert image.output_bytes == base
