"""Writing a library: the same bytes every time, and no file of the user is ever lost."""

import json
import os
import shutil
from pathlib import Path

import pytest

from conftest import names, naming
from ecatd.base.errors import NotPermittedError, StateError, UsageError
from ecatdev import sample_buses
from ecatgen import generate
from ecatgen.output import MANIFEST, Report, install


def contents(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def files(folder: Path) -> dict[str, bytes]:
    """The same without the manifest."""
    found = contents(folder)
    return {path: data for path, data in found.items() if not path.endswith(MANIFEST)}


def put(out: Path, *, check: bool = False, force: bool = False, **names: str) -> Report:
    tree = {name.replace("_", "/"): text.encode() for name, text in names.items()}
    return install(out, {"Plant": tree}, "Plant", check=check, force=force)


def test_r45_the_same_bus_gives_the_same_bytes(tmp_path: Path) -> None:
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
    assert report.summary().startswith(f"{tmp_path / 'Plant'}: 1 file written, 1 unchanged, 1 rem")
    assert json.dumps(report.to_dict())


def test_a_file_that_was_deleted_comes_back(tmp_path: Path) -> None:
    put(tmp_path, a="1", b="2")
    (tmp_path / "Plant" / "a").unlink()
    assert put(tmp_path, a="1", b="2").written == ("Plant/a",)
    assert contents(tmp_path)["Plant/a"] == b"1"


def refused(out: Path, **names: str) -> str:
    before = contents(out)
    with pytest.raises(StateError) as caught:
        put(out, **names)
    assert contents(out) == before
    return str(caught.value)


def test_an_edited_file_is_not_lost(tmp_path: Path) -> None:
    put(tmp_path, a="1", b="2", sub_c="3")
    (tmp_path / "Plant" / "a").write_text("mine")
    (tmp_path / "Plant" / "sub" / "c").write_text("mine, too")
    message = refused(tmp_path, a="1", b="2")
    names(message, tmp_path / "Plant", "a (changed)", "sub/c (changed", "--force", ".orig")
    report = put(tmp_path, force=True, a="1", b="2")
    copies = {"Plant/a": "Plant/a.orig", "Plant/sub/c": "Plant/sub/c.orig"}
    assert (dict(report.copies), report.kept, report.removed) == (copies, (), ())
    assert files(tmp_path) == {
        "Plant/a": b"1",
        "Plant/a.orig": b"mine",
        "Plant/b": b"2",
        "Plant/sub/c.orig": b"mine, too",
    }
    (tmp_path / "Plant" / "a").write_text("again")
    assert put(tmp_path, force=True, a="1").copies == (("Plant/a", "Plant/a.orig2"),)
    assert files(tmp_path)["Plant/a.orig"] == b"mine"


def test_files_of_the_user_stay_where_they_are(tmp_path: Path) -> None:
    put(tmp_path, a="1", sub_b="2")
    plant = tmp_path / "Plant"
    (plant / "notes" / "deep").mkdir(parents=True)
    (plant / "notes" / "mine.txt").write_text("mine")
    (plant / "notes" / "empty").mkdir()
    (plant / "sub" / ".hidden").write_text("mine")
    (plant / "link").symlink_to("notes/mine.txt")
    (plant / "nowhere").symlink_to("/nowhere")
    os.mkfifo(plant / "pipe")
    plant.chmod(0o2775)
    (plant / "notes").chmod(0o711)
    before = (plant / "notes" / "mine.txt").stat()
    report = put(tmp_path, a="2")
    assert report.kept == tuple(
        f"Plant/{name}" for name in ("link", "notes/mine.txt", "nowhere", "pipe", "sub/.hidden")
    )
    assert (report.written, report.removed) == (("Plant/a",), ("Plant/sub/b",))
    after = (plant / "notes" / "mine.txt").stat()
    assert (after.st_ino, after.st_mtime_ns) == (before.st_ino, before.st_mtime_ns)
    assert (plant / "notes" / "empty").is_dir()
    assert (plant / "link").readlink() == Path("notes/mine.txt")
    assert (plant / "nowhere").is_symlink()
    assert (plant / "pipe").is_fifo()
    assert plant.stat().st_mode & 0o7777 == 0o2775
    assert (plant / "notes").stat().st_mode & 0o777 == 0o711
    assert not put(tmp_path, a="2").is_change


def test_unchanged_files_are_not_written_again(tmp_path: Path) -> None:
    put(tmp_path, a="1", b="2")
    before = (tmp_path / "Plant" / "a").stat()
    put(tmp_path, a="1", b="3")
    after = (tmp_path / "Plant" / "a").stat()
    assert (after.st_ino, after.st_mtime_ns) == (before.st_ino, before.st_mtime_ns)


def test_a_new_file_in_the_place_of_one_of_the_user(tmp_path: Path) -> None:
    put(tmp_path, a="1")
    (tmp_path / "Plant" / "b").write_text("mine")
    assert "b (not generated)" in refused(tmp_path, a="1", b="2")
    put(tmp_path, force=True, a="1", b="2")
    assert files(tmp_path)["Plant/b.orig"] == b"mine"
    put(tmp_path / "same", a="1")
    (tmp_path / "same" / "Plant" / "b").write_text("2")
    assert put(tmp_path / "same", a="1", b="2").unchanged == ("Plant/a", "Plant/b")


def test_a_file_in_the_place_of_a_folder_and_the_other_way_round(tmp_path: Path) -> None:
    put(tmp_path, a="1")
    plant = tmp_path / "Plant"
    (plant / "sub").write_text("mine")
    (plant / "b" / "deep").mkdir(parents=True)
    (plant / "b" / "deep" / "x").write_text("mine, too")
    (plant / "c").mkdir()
    message = refused(tmp_path, a="1", sub_x="2", b="3", c="4")
    names(message, "b", "a file", "sub", "a folder", "--force")
    put(tmp_path, force=True, a="1", sub_x="2", b="3", c="4")
    assert files(tmp_path) == {
        "Plant/a": b"1",
        "Plant/b": b"3",
        "Plant/b.orig/deep/x": b"mine, too",
        "Plant/c": b"4",
        "Plant/sub.orig": b"mine",
        "Plant/sub/x": b"2",
    }


def test_a_directory_of_someone_else_is_not_touched(tmp_path: Path) -> None:
    (tmp_path / "Plant").mkdir()
    (tmp_path / "Plant" / "b").write_text("mine")
    names(refused(tmp_path, a="1"), tmp_path / "Plant", "not generated", ".ecatgen.json", "--force")
    put(tmp_path, force=True, a="1", b="2")
    assert files(tmp_path) == {"Plant/a": b"1", "Plant/b": b"2", "Plant/b.orig": b"mine"}


def test_many_conflicts_are_counted(tmp_path: Path) -> None:
    made = {f"f{n:02}": "1" for n in range(12)}
    put(tmp_path, **made)
    for name in made:
        (tmp_path / "Plant" / name).write_text("mine")
    message = refused(tmp_path, **made)
    names(message, "f07 (changed)", "4 more")
    assert "f08" not in message


def test_r39_links_are_not_followed(tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "precious").write_text("1")
    out = tmp_path / "out"
    put(out, a="1", sub_b="2")
    (out / "Plant" / "a").unlink()
    (out / "Plant" / "a").symlink_to(elsewhere / "precious")
    names(refused(out, a="1", sub_b="2"), "a (changed)")
    put(out, force=True, a="3", sub_b="2")
    assert (out / "Plant" / "a.orig").is_symlink()
    shutil.rmtree(out / "Plant" / "sub")
    (out / "Plant" / "sub").symlink_to(elsewhere)
    names(refused(out, a="3", sub_b="2"), "sub", "a folder")
    put(out, force=True, a="3", sub_b="2")
    assert (out / "Plant" / "sub.orig").is_symlink()
    assert files(out)["Plant/sub/b"] == b"2"
    other = tmp_path / "other"
    other.mkdir()
    (other / "Plant").symlink_to(elsewhere)
    names(refused(other, a="1"), other / "Plant", "link", elsewhere)
    assert contents(elsewhere) == {"precious": b"1"}


@pytest.mark.parametrize("text", ["", "{", "[]", '{"schema": 2, "files": {}}', '{"schema": 1}'])
def test_a_damaged_manifest_is_no_licence_to_overwrite(tmp_path: Path, text: str) -> None:
    put(tmp_path, a="1", b="2")
    (tmp_path / "Plant" / MANIFEST).write_text(text)
    names(refused(tmp_path, a="2", b="2"), tmp_path / "Plant", "damaged", ".ecatgen.json")
    put(tmp_path, force=True, a="2", b="2")
    assert files(tmp_path) == {"Plant/a": b"2", "Plant/a.orig": b"1", "Plant/b": b"2"}
    assert not put(tmp_path, a="2", b="2").is_change


def test_an_empty_directory_is_taken(tmp_path: Path) -> None:
    (tmp_path / "Plant").mkdir()
    put(tmp_path, a="1")
    assert contents(tmp_path)["Plant/a"] == b"1"


def test_classes_of_the_user_come_behind_the_generated_ones(tmp_path: Path) -> None:
    tree = {
        "package.mo": b"",
        "package.order": b"Examples\nEL1018\nfingerprint\n",
        "EL1018.mo": b"",
        "Examples/package.mo": b"",
        "Examples/package.order": b"AllSlaves\n",
        "Examples/AllSlaves.mo": b"",
    }

    def write(**options: bool) -> Report:
        return install(tmp_path, {"Plant": tree}, "Plant", **options)

    write()
    plant = tmp_path / "Plant"
    (plant / "Mine").mkdir()
    for name in ("Mine/package.mo", "Mine/Inner.mo", "Zebra.mo", "Ape.mo", "no-class.mo", "x.txt"):
        (plant / name).write_text("mine")
    (plant / "Examples" / "Own.mo").write_text("mine")
    (plant / "package.order").write_text("Zebra\nEL1018\nExamples\nfingerprint\nGone\n")
    assert write().written == ("Plant/Examples/package.order", "Plant/package.order")
    assert (plant / "package.order").read_text().split() == [
        *("Examples", "EL1018", "fingerprint", "Zebra", "Ape", "Mine")
    ]
    assert (plant / "Examples" / "package.order").read_text().split() == ["AllSlaves", "Own"]
    assert not (plant / "Mine" / "package.order").exists()
    assert not write(check=True).is_change
    (plant / "fingerprint.mo").write_text("mine")
    (plant / "EL1018").mkdir()
    (plant / "EL1018" / "package.mo").write_text("mine")
    with pytest.raises(StateError) as caught:
        write()
    names(caught.value, "EL1018 (has the name", "fingerprint.mo (has the name")
    write(force=True)
    assert (plant / "EL1018.orig" / "package.mo").read_text() == "mine"
    assert "EL1018.orig" not in (plant / "package.order").read_text()
    (plant / "Ape.mo").unlink()
    write()
    assert "Ape" not in (plant / "package.order").read_text()


def test_check_says_what_would_change_and_writes_nothing(tmp_path: Path) -> None:
    def checked(**made: str) -> Report:
        before = contents(tmp_path)
        report = put(tmp_path, check=True, **made)
        assert contents(tmp_path) == before
        return report

    assert checked(a="1").written == ("Plant/a",)
    assert not (tmp_path / "Plant").exists()
    put(tmp_path, a="1", b="2")
    assert checked(a="1", b="2").would() == f"{tmp_path / 'Plant'}: nothing would change"
    (tmp_path / "Plant" / "mine").write_text("mine")
    report = checked(a="3")
    assert (report.written, report.removed, report.kept) == (
        *(("Plant/a",), ("Plant/b",), ("Plant/mine",)),
    )
    names(report.would(), tmp_path / "Plant", "would change", "1 file written", "0 unchanged")
    names(report.would(), "1 removed", "1 of yours kept")
    (tmp_path / "Plant" / "a").write_text("changed")
    report = checked(a="1", b="2")
    assert report.conflicts == (("Plant/a", "changed"),)
    assert report.is_change
    names(report.would(), "refused", "--force", "Plant/a (changed)")
    assert report.to_dict()["conflicts"] == {"Plant/a": "changed"}
    (tmp_path / "Plant" / MANIFEST).unlink()
    ((_, why),) = (conflict for conflict in checked().conflicts if conflict[0] == "Plant")
    names(why, "not generated", ".ecatgen.json")
    assert put(tmp_path / "none" / "there", check=True, a="1").is_change
    assert not (tmp_path / "none").exists()


def test_a_file_in_the_place_of_the_directory(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("mine")
    with pytest.raises(StateError, match=naming(tmp_path / "out", "not a directory")):
        put(tmp_path / "out", a="1")
    with pytest.raises(StateError, match=naming(tmp_path / "out", "not a directory")):
        put(tmp_path / "out" / "deeper", a="1")
    (tmp_path / "Plant").write_text("mine")
    with pytest.raises(StateError, match=naming(tmp_path / "Plant", "not a directory")):
        put(tmp_path, a="1")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
@pytest.mark.unprivileged
def test_a_directory_that_cannot_be_written(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(NotPermittedError, match=naming(tmp_path, "Permission denied")):
        put(tmp_path, a="1")


def test_a_wrong_name_writes_nothing(tmp_path: Path) -> None:
    with pytest.raises(UsageError):
        generate(sample_buses.troll(), "9Plant", tmp_path / "out")
    assert not (tmp_path / "out").exists()
