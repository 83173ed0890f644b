"""A list of devices and their ESI files become a rig."""

import tomllib
from pathlib import Path
from typing import Any

import pytest
from esi_sample import SAMPLE

from conftest import names, naming
from ecatd.base.errors import ConfigError, UsageError
from ecatd.cli.esi_rig import expected, listed, rig


@pytest.fixture
def sample(tmp_path: Path) -> Path:
    path = tmp_path / 'odd "name" µ.xml'
    path.write_text(SAMPLE, "utf-8")
    return path


def slaves(devices: str, *files: Path) -> list[dict[str, Any]]:
    made = tomllib.loads(rig([str(file) for file in files], listed(devices)))
    assert set(made) == {"name", "slave"}
    return list(made["slave"])


def test_types_counts_revisions_and_product_codes(sample: Path) -> None:
    made = slaves(" DI4 , 2*DI4:1, AX2 : 0x00010000,0x1234:131073,#x5678", sample)
    assert {row["esi"] for row in made} == {str(sample)}
    assert [(row["type"], row["product"], row["revision"]) for row in made] == [
        ("DI4", 0x5678, 1),
        ("DI4", 0x5678, 1),
        ("DI4", 0x5678, 1),
        ("AX2", 0x1234, 0x00010000),
        ("AX2", 0x1234, 0x00020001),
        ("DI4", 0x5678, 1),
    ]


def test_a_list_in_a_file(sample: Path, tmp_path: Path) -> None:
    file = tmp_path / "devices.txt"
    file.write_text("# the line of the press\n\nAX2:0x00020001  # the axis\n2 * DI4\n")
    assert [row["type"] for row in slaves(str(file), sample)] == ["AX2", "DI4", "DI4"]
    file.write_text("DI4\n0*DI4\n")
    with pytest.raises(UsageError, match=naming("devices.txt:2", "'0*DI4'")):
        slaves(str(file), sample)
    file.write_text("# nothing\n")
    with pytest.raises(UsageError, match=naming(file, "no device")):
        slaves(str(file), sample)


def test_a_folder_of_files(sample: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.mkdir()
    with pytest.raises(UsageError, match=naming(other, ".xml")):
        slaves("DI4", other)
    (other / "B.XML").write_text(SAMPLE.replace("DI4", "DI8"), "utf-8")
    made = slaves("DI8,DI4", sample, other)
    assert [Path(row["esi"]).name for row in made] == ["B.XML", sample.name]


def test_an_untidy_folder(sample: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "vendors"
    (folder / "deep" / "er").mkdir(parents=True)
    good = folder / "deep" / "er" / "good.xml"
    good.write_text(SAMPLE, "utf-8")
    for name, text in (
        ("empty.xml", ""),
        ("foreign.xml", "<Network/>"),
        ("cut.xml", SAMPLE[:900]),
        ("modules.xml", "<EtherCATModule/>"),
        ("readme.txt", "not XML"),
        (".hidden.xml", "not XML"),
    ):
        (folder / name).write_text(text, "utf-8")
    (row,) = slaves("DI4:#x1", folder)
    assert (row["esi"], row["strict"]) == (str(good), False)
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 4
    for line, name in zip(said, ("cut", "empty", "foreign", "modules"), strict=True):
        names(line, "ecatctl: warning:", "left out")
        assert f"{folder / name}.xml" in line
    with pytest.raises(ConfigError, match=naming(folder / "cut.xml")):
        rig([str(folder)], listed("DI4"), strict=True)
    good.unlink()
    with pytest.raises(ConfigError, match=naming(folder / "cut.xml")):
        slaves("DI4", folder)
    with pytest.raises(ConfigError, match=naming(folder / "empty.xml")):
        slaves("DI4", sample, folder / "empty.xml")


def test_a_configuration_knows_the_vendor(
    sample: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other.xml"
    other.write_text(SAMPLE.replace("#x0000FFFF", "#x0000FFFE"), "utf-8")
    config = tmp_path / "ecat0.toml"
    config.write_text("[[slave]]\nposition = 0\nvendor = 0xFFFE\nproduct = 0x5678\n")
    (row,) = tomllib.loads(rig([str(sample), str(other)], expected(config)))["slave"]
    assert row["esi"] == str(other)
    with pytest.raises(UsageError, match=naming("2 devices", "give only its file", other)):
        slaves("DI4", sample, other)


@pytest.mark.parametrize(
    ("devices", "message"),
    [
        ("DI4,,DI4", "'' | EL1018 | 3*EL1018 | EL1018:0x00110000"),
        ("0*DI4", "'0*DI4' | 3*EL1018"),
        ("DI4:0x1ffffffff", "no device | 'DI4:0x1ffffffff'"),
        ("DI4:4294967296", "'DI4:4294967296'"),
        ("9999*DI4", "--devices | 1024"),
        ("DI5", "no device | 'DI5' | AX2"),
        ("AX2", "2 devices | AX2 | 0x00001234"),
        ("0x1235", "no device | product 0x00001235"),
    ],
)
def test_wrong_lists(sample: Path, devices: str, message: str) -> None:
    with pytest.raises(UsageError) as caught:
        slaves(devices, sample)
    names(caught.value, *message.split(" | "))


def test_the_same_device_in_two_files(
    sample: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    twin = tmp_path / "twin.xml"
    twin.write_text(SAMPLE, "utf-8")
    assert [row["esi"] for row in slaves("DI4", sample, twin)] == [str(sample)]
    names(capsys.readouterr().err, twin, "DI4", "is left out", sample)
    twin.write_text(SAMPLE.replace("<BitLen>1<", "<BitLen>8<"), "utf-8")
    with pytest.raises(UsageError, match=naming("'DI4'", "2 devices", "revision", twin)):
        slaves("DI4", sample, twin)
    with pytest.raises(UsageError, match=naming("no device", "'DI5'")):
        slaves("DI5", sample, twin)
