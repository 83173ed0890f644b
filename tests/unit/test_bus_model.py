"""The bus description and its layout in the logical address space."""

import json
from dataclasses import replace

from ecatd.description.bus import Bus, Domain, Slave
from ecatd.description.bus_reader import read_bus
from ecatd.etg.pdo import Entry, Pdo


def slave(position: int, out_bits: list[int], in_bits: list[int]) -> Slave:
    def pdo(index: int, base: int, bits: list[int]) -> list[Pdo]:
        entries = [Entry(base, n + 1, f"e{n}", 0x0005, size) for n, size in enumerate(bits)]
        return [Pdo(index, "", 2, entries)] if bits else []

    return Slave(
        position,
        f"S{position}",
        2,
        7,
        1,
        outputs=pdo(0x1600, 0x7000, out_bits),
        inputs=pdo(0x1A00, 0x6000, in_bits),
    )


def bus(*slaves: Slave) -> Bus:
    return Bus("b", 1000, list(slaves))


def test_fingerprint_follows_what_decides_where_values_lie() -> None:
    first = bus(slave(0, [8], [8]))
    same = bus(replace(slave(0, [8], [8]), name="other", serial=5, alias=7))
    assert first.fingerprint == same.fingerprint
    for other in (
        bus(slave(0, [8], [16])),
        bus(slave(0, [8], [8]), slave(1, [], [])),
        bus(replace(slave(0, [8], [8]), product=8)),
        bus(replace(slave(0, [8], [8]), revision=2)),
    ):
        assert other.fingerprint != first.fingerprint


def test_entries_skip_gaps_but_count_their_bits() -> None:
    one = slave(0, [], [1, 7, 16])
    one.inputs[0].entries[1].index = 0
    assert [(e.subindex, bit) for _, e, bit in one.entries(outputs=False)] == [(1, 0), (3, 8)]


def test_domains_travel_with_the_description() -> None:
    made = bus(replace(slave(0, [8], [8]), domain=1), slave(1, [8], []))
    made.domains = [Domain(), Domain("slow", 4)]
    read = read_bus(json.loads(json.dumps(made.to_dict())), "x")
    assert read == made
    assert (read.domain_label(0), read.domain_label(1)) == ("domain 0", "domain 1 (slow)")
    assert read.output_cycles == 4
    made.slaves[0].outputs = []  # inputs alone are not waited for
    assert made.output_cycles == 1
    old = made.to_dict()
    del old["domains"]
    assert read_bus(old, "x").domain_label(1) == "domain 1"
