"""A library changes as a whole, whatever happens meanwhile."""

import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import killed_install
import pytest

from conftest import names, naming
from ecatd.base.errors import StateError
from ecatd.base.timeouts import Timeout
from ecatgen.output import install, swap

MINE = {"Mine.mo": "mine"}
BEFORE = {path: data.decode() for path, data in killed_install.OLD.items()} | MINE
AFTER = {path: data.decode() for path, data in killed_install.NEW.items()} | MINE
ORDERED = {"package.order": "a\nMine\n"}


def put(out: Path, text: str, *names: str, force: bool = False) -> dict[str, str]:
    tree = {name: text.encode() for name in names or ("a", "b")}
    return dict(install(out, {"Plant": tree}, "Plant", force=force).copies)


def names_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("way", ["exchange", "rename"])
def test_a_run_that_is_killed_leaves_the_old_library_or_the_new_one(
    tmp_path: Path, way: str
) -> None:
    script = Path(killed_install.__file__)
    ended = subprocess.run(
        [sys.executable, script, tmp_path, way], capture_output=True, text=True, check=False
    )
    assert ended.returncode == 0, ended.stderr
    found = json.loads(ended.stdout)
    states = set()
    for died, after, then, left in found:
        assert then == AFTER | ORDERED
        assert left == []
        if died and after == BEFORE:
            states.add("old")
        elif after == AFTER | ORDERED:
            states.add("new")
        else:
            assert (way, after) == ("rename", None)
            states.add("away")
    assert states == ({"old", "new"} if way == "exchange" else {"old", "new", "away"})
    assert len(found) > 50


@pytest.mark.long
def test_at_no_moment_is_half_a_library_seen(tmp_path: Path) -> None:
    """Several processes write into one directory while this one looks."""
    put(tmp_path, "0")
    plant = tmp_path / "Plant"
    (plant / "mine").write_text("mine")
    program = (
        "import sys, pathlib; from ecatgen.output import install\n"
        "for n in range(25):\n"
        "  tree = {name: (sys.argv[2] + str(n)).encode() for name in ('a', 'b', 'c')}\n"
        "  install(pathlib.Path(sys.argv[1]), {'Plant': tree}, 'Plant')\n"
    )
    writers = [subprocess.Popen([sys.executable, "-c", program, tmp_path, name]) for name in "xyz"]
    seen = set()
    while any(writer.poll() is None for writer in writers):
        folder = os.open(plant, os.O_RDONLY)  # this fails if there is no library for a moment
        try:
            texts = [read_in(folder, name) for name in ("a", "b")]
        except FileNotFoundError:
            continue  # an old one, which is being removed
        finally:
            os.close(folder)
        assert texts[0] == texts[1]
        assert (plant / "mine").exists()
        seen.add(texts[0])
    assert [writer.wait() for writer in writers] == [0, 0, 0]
    assert len(seen) > 1
    assert names_in(tmp_path) == ["Plant"]


def read_in(folder: int, name: str) -> bytes:
    file = os.open(name, os.O_RDONLY, dir_fd=folder)
    with os.fdopen(file, "rb") as stream:
        return stream.read()


def test_a_second_run_waits_for_the_first(tmp_path: Path) -> None:
    put(tmp_path, "1")
    with swap.locked(tmp_path):
        second = threading.Thread(target=put, args=(tmp_path, "2"))
        second.start()
        second.join(0.3)
        assert second.is_alive()
        assert (tmp_path / "Plant" / "a").read_text() == "1"
    second.join()
    assert (tmp_path / "Plant" / "a").read_text() == "2"


def test_folders_with_a_similar_name_are_not_ours(tmp_path: Path) -> None:
    (tmp_path / ".ecatgen-mine" / "notes").mkdir(parents=True)
    (tmp_path / ".ecatgen-file").write_text("mine")
    (tmp_path / ".ecatgen-left" / "new" / "Plant").mkdir(parents=True)
    put(tmp_path, "1")
    assert names_in(tmp_path) == [".ecatgen-file", ".ecatgen-mine", "Plant"]


def test_a_run_that_does_not_end_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(swap, "_PATIENCE", Timeout(0.0))
    with swap.locked(tmp_path), pytest.raises(StateError, match=naming(tmp_path, "another run")):
        put(tmp_path, "1")


def test_what_the_user_saves_meanwhile_is_not_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put(tmp_path, "1", "a", "b", "c")
    plant = tmp_path / "Plant"
    for name in ("in place", "replaced", "untouched"):
        (plant / name).write_text("mine")
    exchange: Callable[[Path, Path, Path], None] = swap._exchange

    def save_and_exchange(folder: Path, new: Path, old: Path) -> None:
        (plant / "in place").write_text("saved")
        for name in ("replaced", "a", "c"):
            (plant / "temporary").write_text(f"saved {name}")
            (plant / "temporary").replace(plant / name)
        (plant / "made").mkdir()
        (plant / "made" / "now").write_text("new")
        exchange(folder, new, old)

    monkeypatch.setattr(swap, "_exchange", save_and_exchange)
    copies = put(tmp_path, "2", "a", "b")
    assert copies == {"Plant/a": "Plant/a.orig", "Plant/c": "Plant/c.orig"}
    texts = {
        path.relative_to(plant).as_posix(): path.read_text()
        for path in plant.rglob("[!.]*")
        if path.is_file()
    }
    assert texts == {
        "a": "2",
        "a.orig": "saved a",
        "b": "2",
        "c.orig": "saved c",
        "in place": "saved",
        "made/now": "new",
        "replaced": "saved replaced",
        "untouched": "mine",
    }
    assert names_in(tmp_path) == ["Plant"]


def test_a_disk_that_is_full(tmp_path: Path) -> None:
    """The limit of a process for the size of files is as real an error as that of a disk."""
    put(tmp_path, "1")
    program = (
        "import sys, pathlib, resource; from ecatgen.output import install\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n"
        "install(pathlib.Path(sys.argv[1]), {'Plant': {'a': b'2', 'b': b'2' * 2000}}, 'Plant')\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program, tmp_path], capture_output=True, text=True, check=False
    )
    said = ended.stderr.strip().splitlines()[-1]
    assert said.startswith("ecatd.base.errors.StateError: ")
    names(said, "File too large")
    assert (tmp_path / "Plant" / "a").read_text() == "1"
    assert names_in(tmp_path) == ["Plant"]


@pytest.mark.parametrize("way", ["exchange", "rename"])
def test_a_folder_that_cannot_be_replaced_is_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, way: str
) -> None:
    put(tmp_path, "1")
    if way == "rename":
        monkeypatch.setattr(swap, "_exchange_at_once", lambda *_: False)
    build: Callable[..., None] = swap._build

    def build_and_lose(plan: swap.Plan, new: Path) -> None:
        build(plan, new)
        new.rename(new.with_name("lost"))

    monkeypatch.setattr(swap, "_build", build_and_lose)
    with pytest.raises(StateError, match="No such file"):
        put(tmp_path, "2")
    assert (tmp_path / "Plant" / "a").read_text() == "1"
    assert names_in(tmp_path) == ["Plant"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
@pytest.mark.unprivileged
def test_folders_of_the_user_that_may_not_be_written(tmp_path: Path) -> None:
    put(tmp_path, "1")
    locked = tmp_path / "Plant" / "locked"
    locked.mkdir()
    (locked / "mine").write_text("mine")
    locked.chmod(0o555)
    put(tmp_path, "2")
    assert (locked / "mine").read_text() == "mine"
    assert locked.stat().st_mode & 0o777 == 0o555
    assert names_in(tmp_path) == ["Plant"]
    locked.chmod(0o755)
