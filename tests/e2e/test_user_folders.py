"""Device profiles and templates of the user, by options and in the standard folders."""

import json
from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess

import pytest

from conftest import one_line_error, run_module
from ecatd.model import bus_file
from ecatgen.checks import sample_buses

PROFILE = """
[[device]]
description = "EL1018 as a number"
vendor = 2
product = [0x03FA3052]
[[device.entry]]
index = 0x6000
subindex = 1
unit = "{unit}"
scale = 2
"""
OTHER = PROFILE.replace("0x03FA3052", "0x12345678").replace("EL1018", "something else")

Generate = Callable[..., CompletedProcess[str]]


@pytest.fixture
def generate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Generate:
    """Runs `ecatctl generate` on a saved scan, with an empty folder as that of the user."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    scan = tmp_path / "bus.json"
    scan.write_text(bus_file.dump(sample_buses.troll()))

    def run(*options: str) -> CompletedProcess[str]:
        where = ("P", str(tmp_path / "out"), "--from", str(scan))
        return run_module("ecatd.cli", "generate", *where, *options)

    return run


def folder(path: Path, name: str, text: str) -> str:
    path.mkdir(parents=True, exist_ok=True)
    (path / name).write_text(text)
    return str(path)


def unit(tmp_path: Path) -> str:
    source = (tmp_path / "out" / "P" / "EL1018.mo").read_text()
    _, _, rest = source.partition("channel1Input(")
    return rest.partition('unit = "')[2].partition('"')[0] if rest.startswith("quan") else ""


def test_the_first_folder_wins_and_the_standard_one_is_last(
    generate: Generate, tmp_path: Path
) -> None:
    assert generate().returncode == 0
    assert unit(tmp_path) == ""
    folder(tmp_path / "config" / "ecatd" / "profiles", "a.toml", PROFILE.format(unit="V"))
    assert "would change" in generate("--check").stdout
    assert generate().returncode == 0
    assert unit(tmp_path) == "V"
    one = folder(tmp_path / "one", "a.toml", PROFILE.format(unit="A"))
    two = folder(tmp_path / "two", "a.toml", PROFILE.format(unit="K"))
    assert generate("--profiles", one, "--profiles", two).returncode == 0
    assert unit(tmp_path) == "A"


def test_a_profile_that_fits_no_slave_is_told(generate: Generate, tmp_path: Path) -> None:
    given = folder(tmp_path / "one", "a.toml", PROFILE.format(unit="V") + OTHER.format(unit="V"))
    told = (
        f"{given}/a.toml: 'something else as a number' fits no slave of bus ecat0: it is about "
        "vendor 0x00000002, product 0x12345678"
    )
    assert generate("--profiles", given).stdout.splitlines()[0] == told
    assert json.loads(generate("--profiles", given, "--json").stdout)["unused_profiles"] == [told]
    # Who keeps profiles for all of their machines does not want to hear of them each time.
    folder(tmp_path / "config" / "ecatd" / "profiles", "a.toml", OTHER.format(unit="V"))
    assert "fits no slave" not in generate().stdout


def test_templates_replace_files(generate: Generate, tmp_path: Path) -> None:
    standard = tmp_path / "config" / "ecatd" / "templates"
    folder(standard, "users_guide.mo.j2", "standard\n")
    folder(standard, "examples.mo.j2", "standard\n")
    given = folder(tmp_path / "one", "users_guide.mo.j2", "given {{ library.bus }}\n")
    assert generate("--templates", given).returncode == 0
    library = tmp_path / "out" / "P"
    assert (library / "UsersGuide.mo").read_text() == "given ecat0\n"
    assert (library / "Examples" / "package.mo").read_text() == "standard\n"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--profiles", "nowhere"), "nowhere: is no folder"),
        (("--templates", "nowhere"), "nowhere: is no folder"),
        (("--templates", ".", "--fmu"), "leave them out with --fmu"),
    ],
)
def test_wrong_folders_are_one_sentence(
    generate: Generate, options: tuple[str, ...], message: str
) -> None:
    done = generate(*options)
    assert done.returncode == 2
    assert message in one_line_error(done.stderr, "ecatctl")
