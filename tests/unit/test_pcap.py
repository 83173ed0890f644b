"""Captures: what is read of them, in every format, and what a rig of one is."""

from pathlib import Path

import pytest
from pcap_sample import (
    CYCLES,
    LOGICAL,
    cooked,
    over_udp,
    pcap,
    pcapng,
    pcapng_big,
    sample,
    tagged,
)

from conftest import names, naming
from ecatd.base.errors import ConfigError, StateError
from ecatd.base.pcap_reader import PcapReader
from ecatsim.devices.generic_drive import CiA402Drive
from ecatsim.files import rig_file
from ecatsim.files.rig_writer import rig_text
from ecatsim.pcap.report import document, faults, lines, read_capture, unknown
from ecatsim.pcap.rig import captured_slaves

pytestmark = pytest.mark.unprivileged

FRAMES, SIZES, WORDS = sample()
FORMATS = {
    "pcapng": pcapng(FRAMES),
    "pcapng, other byte order": pcapng_big(FRAMES),
    "pcap": pcap(FRAMES),
    "pcap, ns": pcap(FRAMES, nanoseconds=True),
    "pcap, other byte order": pcap(FRAMES, ">"),
    "VLAN": pcap(FRAMES, cover=tagged),
    "Linux cooked": pcap(FRAMES, link=113, cover=cooked),
    "UDP": pcap(FRAMES, cover=over_udp),
}


@pytest.mark.parametrize("kind", FORMATS)
def test_all_formats_tell_the_same(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "x.pcapng"
    path.write_bytes(FORMATS[kind])
    capture = read_capture(path)
    found = document(capture)
    assert found["frames"] == len(FRAMES)
    assert found["unknown"] == []
    (slave,) = found["slaves"]
    drive = CiA402Drive()
    identity = (drive.vendor, drive.product, drive.revision)
    assert (slave["vendor"], slave["product"], slave["revision"]) == identity
    assert (slave["position"], slave["station"], slave["name"]) == (0, 0x1001, "CiA402")
    assert (slave["output_bytes"], slave["input_bytes"]) == SIZES
    assert slave["eeprom"] == "whole"
    states = [item["state"] for item in slave["states"]]
    assert states == ["PREOP", "SAFEOP", "OP"]
    sdos = {(s["index"], s["written"]): s for s in slave["sdos"]}
    assert sdos[0x1018, False]["data"] == drive.vendor.to_bytes(4, "little").hex()
    assert bytes.fromhex(sdos[0x1008, False]["data"]).startswith(b"CiA402")
    assert sdos[0x6065, True]["data"] == "d2040000"
    assert sdos[0x5555, False]["abort_code"] == 0x06020000
    (area,) = found["process_data"]
    assert (area["command"], area["address"], area["bytes"]) == ("LRW", LOGICAL, sum(SIZES))
    assert (area["exchanges"], area["lost"]) == (CYCLES, 1)
    assert area["working_counters"] == {"3": CYCLES - 2, "2": 1}
    assert area["cycle_us"]["median"] == pytest.approx(2000, abs=1)
    told = "\n".join(faults(capture))
    for words in (
        ["1 of", "did not come back"],
        ["LRW", "not always 3"],
        ["slave 0 (CiA402)", "read 0x5555:00", "0x06020000"],
        ["emergency 0x5112", "error register 0x04", "01 02 03 04 05"],
    ):
        names(told, *words)
    assert any("CiA402" in line for line in lines(capture))


def test_a_rig_of_it_is_the_same_slave(tmp_path: Path) -> None:
    path = tmp_path / "x.pcapng"
    path.write_bytes(FORMATS["pcapng"])
    (slave,) = captured_slaves(read_capture(path).segment)
    assert slave.notes == []
    file = tmp_path / "rig.toml"
    file.write_text(rig_text("copy", [slave]))
    (device,) = rig_file.load(file).devices
    original = CiA402Drive()
    assert (device.vendor, device.product) == (original.vendor, original.product)
    assert device.sii_image()[:128] == original.sii_image()[:128]
    assert [pdo.index for pdo in device.rx_pdos] == [pdo.index for pdo in original.rx_pdos]
    assert device.chip == original.chip


def test_what_the_capture_lacks_is_named(tmp_path: Path) -> None:
    path = tmp_path / "x.pcapng"
    begins = next(n for n, f in enumerate(FRAMES) if f.data[16] == 12)  # with the cycles
    path.write_bytes(pcapng(FRAMES[begins:]))
    capture = read_capture(path)
    assert document(capture)["process_data"][0]["exchanges"] == CYCLES
    with pytest.raises(StateError, match=naming("what the slaves are", "before the master starts")):
        captured_slaves(capture.segment)
    writes = (2, 5)  # APWR, FPWR
    commands = [
        n for n, f in enumerate(FRAMES) if f.data[16] in writes and f.data[18:22] == b"\0\0\x02\x05"
    ]
    path.write_bytes(pcapng(FRAMES[: commands[len(commands) // 2]]))
    capture = read_capture(path)
    assert any("a part" in text for text in unknown(capture))
    (slave,) = captured_slaves(capture.segment)
    assert any("the rest" in note for note in slave.notes)
    file = tmp_path / "rig.toml"
    file.write_text(rig_text("part", [slave]))
    assert "# not captured: " in file.read_text()
    assert rig_file.load(file).devices[0].product == CiA402Drive.product


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "this is not a capture"),
        (b"#!/bin/sh\n", "this is not a capture"),
        (b"\x1f\x8b\x08\0rest", "unpack it first"),
    ],
)
def test_other_files_are_refused(data: bytes, words: str, tmp_path: Path) -> None:
    path = tmp_path / "x.pcapng"
    path.write_bytes(data)
    with pytest.raises(ConfigError, match=words):
        list(PcapReader(path).frames())
    with pytest.raises(ConfigError, match="cannot be read"):
        list(PcapReader(tmp_path / "no.pcapng").frames())


@pytest.mark.parametrize("kind", ["pcapng", "pcap"])
def test_a_file_that_was_cut_short_is_read_as_far_as_it_goes(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "x.pcapng"
    whole = FORMATS[kind][:3000]
    for size in range(30, len(whole), 7):
        path.write_bytes(whole[:size])
        reader = PcapReader(path)
        frames = list(reader.frames())
        assert len(frames) < len(FRAMES)
        assert all(len(frame.data) == frame.length for frame in frames)
    assert any("ends within" in remark for remark in reader.remarks)


def test_hostile_sizes_take_no_memory(tmp_path: Path) -> None:
    path = tmp_path / "x.pcapng"
    head = FORMATS["pcapng"][:200]
    for data in (
        head[:4] + b"\xfc\xff\xff\xff" + head[8:],
        FORMATS["pcap"][:24] + b"\0" * 8 + b"\xff\xff\xff\x7f" * 2,
        FORMATS["pcap, other byte order"][:24] + b"\0" * 8 + b"\x7f\xff\xff\xff" * 2,
    ):
        path.write_bytes(data)
        reader = PcapReader(path)
        assert list(reader.frames()) == []
        assert any("left out" in remark for remark in reader.remarks)
