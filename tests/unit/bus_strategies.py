"""Buses of all kinds, for hypothesis: whatever a saved scan may hold."""

from dataclasses import replace

from hypothesis import strategies as st

from ecatd.description.bus import Bus, ProfileName, Slave
from ecatd.etg.datatypes import DataType, bit_length, is_real
from ecatd.etg.pdo import Entry, Pdo, Value

_LARGE = 1.7e308

_names = st.text(max_size=8)
_letters = st.text('µ°Ω"*/\\ ?', max_size=7)  # printable, as units of the configuration are
_indices = st.sampled_from([0, 0x6040, 0x6041, 0x6060, 0x607A, 0x60FF, 0x606C, 0x6000, 0x7000])
_entries = st.builds(
    Entry,
    index=_indices | st.integers(0, 0xFFFF),
    subindex=st.integers(0, 3) | st.integers(0, 0xFF),
    name=_names,
    data_type=st.sampled_from([*map(int, DataType), 0x0800, 0xFFFF]),
    bit_length=st.sampled_from([0, 1, 2, 7, 8, 16, 31, 32, 33, 64, 65, 255]),
    unit=st.sampled_from(["", "V", "rad/s", "%", "nonsense", '"', "*/"]) | _letters,
    scale=st.floats(-_LARGE, _LARGE).filter(bool),
    offset=st.floats(-_LARGE, _LARGE),
    minimum=st.none() | st.floats(-_LARGE, 0),
    maximum=st.none() | st.floats(0, _LARGE),
    display_unit=st.sampled_from(["", "deg", "rad/s2"]),
    quantity=st.sampled_from(["", "Angle"]),
    values=st.lists(st.builds(Value, st.integers(-5, 5), _names), max_size=2),
    note=_names,
    connector=st.booleans(),
    safe=st.none() | st.integers(0, 5) | st.just("hold"),
).map(
    lambda entry: (
        replace(entry, bit_length=bit_length(entry.data_type))
        if is_real(entry.data_type)
        else entry
    )
)
_pdos = st.lists(
    st.builds(
        Pdo, st.integers(0, 0xFFFF), _names, st.integers(0, 255), st.lists(_entries, max_size=4)
    ),
    max_size=3,
)
_slaves = st.builds(
    Slave,
    position=st.just(0),
    name=_names,
    vendor=st.sampled_from([0, 2, 0x9A]),
    product=st.sampled_from([0, 1, 0x00030924, 0x0BC03052]),
    revision=st.integers(0, 0xFFFF_FFFF),
    coe=st.booleans(),
    profiles=st.lists(st.builds(ProfileName, _names, _names), max_size=2),
    outputs=_pdos,
    inputs=_pdos,
    sync_shift_ns=st.integers(-(10**9), 10**9),
    watchdog_ms=st.none() | st.just(0.0) | st.floats(0.1, 6553.5),
)


def _bus(slaves: list[Slave]) -> Bus:
    names = ("axis", "", "Größe-2")
    rows = enumerate(zip(slaves, names, strict=False))
    return Bus(
        "x", 1000, [replace(slave, position=n, given_name=name) for n, (slave, name) in rows]
    )


buses = st.lists(_slaves, max_size=3).map(_bus)
