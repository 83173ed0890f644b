"""Templates of the user, and their documentation."""

import re
from pathlib import Path

import pytest
from pymoca.parser import parse

from conftest import naming
from ecatd.base.errors import ConfigError
from ecatdev import sample_buses
from ecatdev.checks.template_reference import updated
from ecatgen.build import build_library
from ecatgen.render import render

DOCUMENT = Path(__file__).parents[2] / "docs" / "templates.md"
LIBRARY = build_library(sample_buses.troll(), "TrollPlant")


def written(folder: Path, name: str, text: str) -> list[Path]:
    (folder / name).write_text(text)
    return [folder]


def test_a_template_of_the_user_replaces_ours_and_no_other(tmp_path: Path) -> None:
    ours = render(LIBRARY)
    theirs = render(
        LIBRARY, written(tmp_path, "users_guide.mo.j2", "{{ library.bus | html }} only\n")
    )
    assert theirs["UsersGuide.mo"] == b"ecat0 only\n"
    assert {path for path in ours if ours[path] != theirs[path]} == {"UsersGuide.mo"}


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("a\n{% if %}\n", ":2: Expected"),
        ("a\n\n{{ library.nothing }}\n", ":3: "),
        ("{{ block.name.upper(1) }}\n", ":1: "),
        ("{{ 1 // 0 }}\n", ":1: "),
        (
            "{% include 'nowhere.j2' %}",
            ":1: | 'nowhere.j2' | 'ecatgen/'",
        ),
    ],
)
def test_a_wrong_template_is_told_with_its_line(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(ConfigError) as error:
        render(LIBRARY, written(tmp_path, "block.mo.j2", text))
    assert str(tmp_path / "block.mo.j2") in str(error.value)
    for token in told.split(" | "):
        assert token in str(error.value)
    assert "\n" not in str(error.value)


def test_a_template_that_replaces_nothing_is_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=naming("blocks.mo.j2: ", "block.mo.j2")):
        render(LIBRARY, written(tmp_path, "blocks.mo.j2", ""))


def test_a_template_that_cannot_be_read_is_told_with_its_folder(tmp_path: Path) -> None:
    (tmp_path / "block.mo.j2").write_bytes(b"\xff")
    with pytest.raises(ConfigError, match=naming(f"{tmp_path}/block.mo.j2:1: ", "UTF-8")):
        render(LIBRARY, [tmp_path])
    other = tmp_path / "other"
    (other / "block.mo.j2").mkdir(parents=True)
    with pytest.raises(ConfigError, match=naming(f"{other}/block.mo.j2: ", "Is a directory")):
        render(LIBRARY, [other])


def test_a_folder_of_templates_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=naming(tmp_path / "nowhere", "folder")):
        render(LIBRARY, [tmp_path / "nowhere"])


def test_the_documentation_has_every_class_attribute_and_filter() -> None:
    text = DOCUMENT.read_text("utf-8")
    assert "### Connector" in text
    assert updated(text) == text, "python -m ecatdev.checks.template_reference docs/templates.md"


def test_the_documentation_has_every_template() -> None:
    folder = Path(__file__).parents[2] / "codegen" / "ecatgen" / "templates"
    names = {file.name for file in folder.glob("*.j2")}
    assert len(names) > 5
    assert names == set(re.findall(r"`([\w.]+\.j2)`", DOCUMENT.read_text()))


def test_the_template_of_the_documentation(tmp_path: Path) -> None:
    (template,) = re.findall(
        r"^```jinja\n(.*?)^```", DOCUMENT.read_text(), re.MULTILINE | re.DOTALL
    )
    made = render(LIBRARY, written(tmp_path, "block_info.html.j2", template))["EL1018.mo"].decode()
    ours = render(LIBRARY)["EL1018.mo"].decode()
    added = made.replace('href=\\"https://intranet.example/EL1018\\"', "")
    assert len(made) > len(added) > len(ours)
    assert parse(made) is not None
