"""Writing a library: the same bytes every time, and no file of the user is ever lost."""

import json
import os
from pathlib import Path

import pytest

import ecatgen.output
from ecatd.model.errors import NotPermittedError, StateError, UsageError
from ecatgen import generate
from ecatgen.checks import sample_buses
from ecatgen.output import MANIFEST, install


def contents(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def put(out: Path, **files: str) -> ecatgen.output.Report:
    tree = {name.replace("_", "/"): text.encode() for name, text in files.items()}
    return install(out, {"Plant": tree}, "Plant")


def test_the_same_bus_gives_the_same_bytes(tmp_path: Path) -> None:
    one = generate(sample_buses.troll(), "TrollPlant", tmp_path / "one")
    generate(sample_buses.troll(), "TrollPlant", tmp_path / "two")
    first = contents(tmp_path / "one")
    assert first == contents(tmp_path / "two")
    assert one.library == tmp_path / "one" / "TrollPlant"
    assert not one.unchanged
    again = generate(sample_buses.troll(), "TrollPlant", tmp_path / "one")
    assert contents(tmp_path / "one") == first
    assert (again.written, again.removed) == ((), ())
    assert again.unchanged == one.written
    assert str(tmp_path).encode() not in b"".join(first.values())


def test_the_library_lies_beside_a_copy_of_the_static_one(tmp_path: Path) -> None:
    generate(sample_buses.troll(), "TrollPlant", tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["EtherCAT", "TrollPlant"]
    resources = tmp_path / "EtherCAT" / "Resources"
    assert (resources / "Include" / "ecat_modelica.h").is_file()
    assert (resources / "Include" / "ecat" / "ecat.h").is_file()
    assert (resources / "Source" / "client.c").is_file()
    assert [path.name for path in (resources / "Library").rglob("libecat.*")] == ["libecat.a"]


def test_two_libraries_share_the_static_one(tmp_path: Path) -> None:
    generate(sample_buses.troll(), "One", tmp_path)
    report = generate(sample_buses.awkward(), "Two", tmp_path)
    assert not [path for path in report.written if path.startswith("EtherCAT/")]
    assert (tmp_path / "One" / "package.mo").exists()


def test_what_a_new_run_does_not_need_is_removed(tmp_path: Path) -> None:
    put(tmp_path, a="1", b="2", sub_c="3")
    report = put(tmp_path, a="1", b="9")
    assert report.written == ("Plant/b",)
    assert report.unchanged == ("Plant/a",)
    assert report.removed == ("Plant/sub/c",)
    assert set(contents(tmp_path)) == {"Plant/a", "Plant/b", f"Plant/{MANIFEST}"}
    assert report.summary().startswith(f"{tmp_path / 'Plant'}: 1 files written, 1 unchanged, 1 rem")
    assert json.dumps(report.to_dict())


def test_a_file_that_was_deleted_comes_back(tmp_path: Path) -> None:
    put(tmp_path, a="1", b="2")
    (tmp_path / "Plant" / "a").unlink()
    assert put(tmp_path, a="1", b="2").written == ("Plant/a",)
    assert contents(tmp_path)["Plant/a"] == b"1"


def refused(out: Path, **files: str) -> str:
    before = contents(out)
    with pytest.raises(StateError) as caught:
        put(out, **files)
    assert contents(out) == before
    return str(caught.value)


def test_a_foreign_file_is_not_lost(tmp_path: Path) -> None:
    put(tmp_path, a="1")
    (tmp_path / "Plant" / "notes").mkdir()
    (tmp_path / "Plant" / "notes" / "mine.txt").write_text("mine")
    message = refused(tmp_path, a="2")
    assert "notes/mine.txt (not generated)" in message
    assert "Move them away, or choose another directory; nothing was written" in message


def test_an_edited_file_is_not_lost(tmp_path: Path) -> None:
    put(tmp_path, a="1", b="2")
    (tmp_path / "Plant" / "a").write_text("mine")
    assert "a (changed)" in refused(tmp_path, a="1", b="2")


def test_a_directory_of_someone_else_is_not_touched(tmp_path: Path) -> None:
    (tmp_path / "Plant").mkdir()
    for n in range(12):
        (tmp_path / "Plant" / f"{n:02}.mo").write_text("mine")
    message = refused(tmp_path, a="1")
    assert "07.mo (not generated) and 4 more" in message


def test_links_are_not_followed(tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "precious").write_text("mine")
    out = tmp_path / "out"
    put(out, a="1")
    (out / "Plant" / "link").symlink_to(elsewhere)
    assert "link (not generated)" in refused(out, a="2")
    (out / "Plant" / "link").unlink()
    (out / "Plant" / "a").unlink()
    (out / "Plant" / "a").symlink_to(elsewhere / "precious")
    assert "a (changed)" in refused(out, a="2")
    other = tmp_path / "other"
    other.mkdir()
    (other / "Plant").symlink_to(elsewhere)
    assert "is not a directory that this program has made" in refused(other, a="1")
    assert (elsewhere / "precious").read_text() == "mine"


@pytest.mark.parametrize("text", ["", "{", "[]", '{"schema": 2, "files": {}}', '{"schema": 1}'])
def test_a_damaged_manifest_is_no_licence_to_overwrite(tmp_path: Path, text: str) -> None:
    put(tmp_path, a="1")
    (tmp_path / "Plant" / MANIFEST).write_text(text)
    assert "is damaged" in refused(tmp_path, a="2")


def test_an_empty_directory_is_taken(tmp_path: Path) -> None:
    (tmp_path / "Plant").mkdir()
    put(tmp_path, a="1")
    assert contents(tmp_path)["Plant/a"] == b"1"


def test_a_file_that_comes_in_the_middle_is_not_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put(tmp_path, a="1")
    write = ecatgen.output._write

    def write_and_edit(*arguments: object) -> None:
        write(*arguments)  # type: ignore[arg-type]
        (tmp_path / "Plant" / "mine").write_text("mine")

    monkeypatch.setattr(ecatgen.output, "_write", write_and_edit)
    with pytest.raises(StateError, match=r"mine \(not generated\)"):
        put(tmp_path, a="2")
    assert contents(tmp_path)["Plant/mine"] == b"mine"
    assert contents(tmp_path)["Plant/a"] == b"1"
    assert [path.name for path in tmp_path.iterdir()] == ["Plant"]


def test_a_run_that_fails_leaves_everything_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put(tmp_path, a="1")
    before = contents(tmp_path)

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(ecatgen.output, "_write", fail)
    with pytest.raises(StateError, match="No space"):
        put(tmp_path, a="2")
    assert contents(tmp_path) == before
    assert [path.name for path in tmp_path.iterdir()] == ["Plant"]


def test_a_file_in_the_place_of_the_directory(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("mine")
    with pytest.raises(StateError, match="it is no directory"):
        put(tmp_path / "out", a="1")
    with pytest.raises(StateError, match="it is no directory"):
        put(tmp_path / "out" / "deeper", a="1")
    (tmp_path / "Plant").write_text("mine")
    with pytest.raises(StateError, match="is not a directory that this program has made"):
        put(tmp_path, a="1")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
@pytest.mark.unprivileged
def test_a_directory_that_cannot_be_written(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(NotPermittedError, match="cannot be written: Permission denied"):
        put(tmp_path, a="1")


def test_a_wrong_name_writes_nothing(tmp_path: Path) -> None:
    with pytest.raises(UsageError):
        generate(sample_buses.troll(), "9Plant", tmp_path / "out")
    assert not (tmp_path / "out").exists()
