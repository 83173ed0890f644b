"""What `ecatsim capture` writes is read back as it was, whatever slaves say."""

import struct
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ecatd.base.errors import SdoAbortError
from ecatd.etg.datatypes import DataType
from ecatd.etg.dictionary import DictionaryEntry, DictionaryObject
from ecatsim import Device
from ecatsim.capture import CapturedSlave, Upload, topology
from ecatsim.devices.library import make
from ecatsim.esc import Segment
from ecatsim.files import rig_file
from ecatsim.files.rig_writer import rig_text

LINE = 0x0A00  # communication at the ports 0 and 1
CHIP = bytes([0x11, 0, 2, 0, 8, 8, 8, 0x0A, 0x0C, 0])
IMAGE = make("EL3102").sii_image()


def slave(**facts: object) -> CapturedSlave:
    known = {"position": 0, "name": "EL3102", "sii": IMAGE, "chip": CHIP, "coe": True}
    known |= {"clock": True}
    return CapturedSlave(**(known | {"dl_status": LINE} | facts))  # type: ignore[arg-type]


def read_back(folder: Path, *slaves: CapturedSlave) -> list[Device]:
    file = folder / "captured.toml"
    file.write_text(rig_text("captured", slaves), "utf-8")
    return rig_file.load(file).devices


TEXTS = st.text(st.characters(max_codepoint=0xFF), max_size=40)
ENTRIES = st.builds(
    DictionaryEntry,
    TEXTS,
    st.one_of(st.sampled_from([int(kind) for kind in DataType]), st.integers(0, 0xFFFF)),
    st.integers(1, 96),
    st.integers(0, 0xFFFF),
)
UPLOADS = st.one_of(
    st.builds(Upload, st.binary(max_size=12)),
    st.builds(lambda code: Upload(abort=code), st.integers(1, 0xFFFFFFFF)),
)


REAL32_OF_8_BYTES = {
    0: (DictionaryEntry("", DataType.REAL32, 57, 0), Upload(bytes(7) + b"H")),
}


@pytest.mark.long
@settings(max_examples=300)
@example("", 0, REAL32_OF_8_BYTES)
@given(
    TEXTS,
    st.integers(0, 0xFFFF),
    st.dictionaries(st.integers(0, 255), st.tuples(ENTRIES, UPLOADS), min_size=1, max_size=4),
)
def test_any_object(
    tmp_path_factory: pytest.TempPathFactory,
    name: str,
    structure: int,
    rows: dict[int, tuple[DictionaryEntry, Upload]],
) -> None:
    """An object of any shape, with entries of any type, and any answers to uploads."""
    code = 9 if set(rows) - {0} else 7
    entries = {i: row[0] for i, row in rows.items()}
    item = DictionaryObject(
        0x2000, name, code, structure if code == 9 else rows[0][0].data_type, entries
    )
    values = {(0x2000, i): upload for i, (_, upload) in rows.items()}
    captured = slave(objects=[item], values=values)
    (device,) = read_back(tmp_path_factory.getbasetemp(), captured)
    found = device.dictionary.object(0x2000)
    assert (found.name, int(found.code), found.type) == (name, code, item.data_type)
    assert sorted(set(found.entries) - {0}) == sorted(set(rows) - {0})
    for i, (entry, upload) in rows.items():
        variable = found.entries[i]
        facts = (variable.type, variable.bits, int(variable.access))
        assert facts == (entry.data_type, entry.bit_length, entry.access)
        if upload.data is not None:
            assert variable.encode() == upload.data
        elif entry.access & 0x07 or upload.abort != 0x06010001:
            with pytest.raises(SdoAbortError) as error:
                variable.encode()
            assert error.value.code == upload.abort


def test_an_image_with_mistakes_is_served_as_it_is(tmp_path: Path) -> None:
    wrong = bytes([IMAGE[0] ^ 1]) + IMAGE[1:]
    (device,) = read_back(tmp_path, slave(sii=wrong))
    assert device.sii_image() == wrong
    assert "# slave 0: byte 0x000E (word 0x0007): the checksum" in (
        (tmp_path / "captured.toml").read_text()
    )


def test_the_chip_is_that_of_the_slave(tmp_path: Path) -> None:
    registers = struct.pack("<BBHBBBBH", 0x12, 3, 7, 4, 6, 2, 0x3B, 0x0000)
    (device,) = read_back(tmp_path, slave(chip=registers))
    chip = device.chip
    assert (chip.type, chip.revision, chip.build) == (0x12, 3, 7)
    assert (chip.fmmus, chip.sync_managers, chip.ram_kib, chip.ports) == (4, 6, 2, 0x3B)
    assert not chip.dc
    (device,) = read_back(tmp_path, slave(chip=registers[:8] + b"\x04\x00"))
    assert (device.chip.dc, device.chip.dc_bits, device.chip.lrw) == (True, 32, True)
    (device,) = read_back(tmp_path, slave(chip=registers[:8] + b"\x0c\x02"))
    assert (device.chip.dc_bits, device.chip.lrw) == (64, False)


def test_watchdogs_are_those_of_the_slave(tmp_path: Path) -> None:
    (usual, off) = read_back(tmp_path, slave(), slave(position=1, watchdogs=(98, 0, 0)))
    text = (tmp_path / "captured.toml").read_text()
    assert text.count("watchdog") == 3
    assert "strict" not in text
    segment = Segment()
    for device, times in ((usual, (2498, 1000, 1000)), (off, (98, 0, 0))):
        place = segment.add(device.chip, device.sii_image())
        found = [segment.read(place, register, 2) for register in (0x0400, 0x0410, 0x0420)]
        assert tuple(int.from_bytes(data, "little") for data in found) == times
    segment.close()


def test_notes_stay_within_their_comment(tmp_path: Path) -> None:
    captured = slave(name="two\nlines", notes=["object dictionary: no\nanswer = 5"])
    assert len(read_back(tmp_path, captured)) == 1


def open_ports(*ports: int) -> int:
    return sum(1 << 9 + 2 * port for port in ports)


@pytest.mark.parametrize(
    ("ports", "places"),
    [
        ([(0,)], [(-1, 0)]),
        ([(0, 1), (0, 1), (0,)], [(-1, 0), (0, 1), (1, 1)]),
        # Behind a coupler: first what is at port 3, then at 1, then at 2.
        ([(0, 1, 2, 3), (0,), (0,), (0,)], [(-1, 0), (0, 3), (0, 1), (0, 2)]),
        ([(0, 1, 2), (0, 1), (0,), (0, 1), (0,)], [(-1, 0), (0, 1), (1, 1), (0, 2), (3, 1)]),
        # A status that contradicts the order: as a line.
        ([(0,), (0,)], [(-1, 0), (0, 1)]),
        ([], []),
    ],
)
def test_topology(ports: list[tuple[int, ...]], places: list[tuple[int, int]]) -> None:
    assert topology([open_ports(*row) for row in ports]) == places
