"""Files that commands write: those of others are neither followed nor replaced."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import names
from ecatd.base.errors import NotPermittedError, StateError, UsageError
from ecatd.base.files import open_new
from ecatd.cli.saving import check_target, save_bytes

OTHER = 12345
ROOT = pytest.mark.skipif(os.geteuid() != 0, reason="only root can make files of others")


def test_a_dash_is_not_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError) as refused:
        save_bytes(Path("-"), b"data")
    names(refused.value, "'-'", "/dev/stdout")
    assert not list(tmp_path.iterdir())


def theirs(path: Path) -> None:
    os.chown(path, OTHER, OTHER, follow_symlinks=False)


def grow(path: Path) -> None:
    os.close(open_new(path, force=True))


WAYS = [lambda path: save_bytes(path, b"new"), grow]


@ROOT
@pytest.mark.parametrize("write", WAYS)
def test_nothing_of_another_user_is_followed_or_replaced(
    tmp_path: Path, write: Callable[[Path], None]
) -> None:
    mine, link, file, fifo = (tmp_path / name for name in ("mine", "link", "file", "fifo"))
    mine.write_text("old")
    link.symlink_to("mine")
    (tmp_path / "dangling").symlink_to("new")
    (tmp_path / "folder").symlink_to(".")
    (tmp_path / "way").symlink_to("folder/mine")
    file.write_text("old")
    os.mkfifo(fifo)
    for path in (link, tmp_path / "dangling", tmp_path / "folder", file, fifo):
        theirs(path)
    for path in (link, tmp_path / "dangling", tmp_path / "way", file, fifo):
        with pytest.raises((NotPermittedError, PermissionError)) as refused:
            write(path)
        names(refused.value, str(OTHER), "another name")
    with pytest.raises((NotPermittedError, PermissionError)):
        write(tmp_path / "folder" / "mine")
    assert mine.read_text() == file.read_text() == "old"
    assert link.is_symlink()
    assert not (tmp_path / "new").exists()


def test_own_links_are_followed(tmp_path: Path) -> None:
    mine, link = tmp_path / "mine", tmp_path / "link"
    mine.write_text("old")
    link.symlink_to("mine")
    save_bytes(link, b"new")
    assert link.is_symlink()
    assert mine.read_text() == "new"
    os.close(open_new(link, force=True))
    assert mine.read_text() == "new"


def test_what_cannot_be_made_again_needs_force(tmp_path: Path) -> None:
    file = tmp_path / "capture.pcapng"
    save_bytes(file, b"one", force=False)
    for again in (
        lambda: check_target(file, force=False),
        lambda: save_bytes(file, b"two", force=False),
    ):
        with pytest.raises(StateError) as refused:
            again()
        names(refused.value, str(file), "exists", "--force")
    with pytest.raises(FileExistsError):
        open_new(file, force=False)
    assert file.read_bytes() == b"one"
    save_bytes(file, b"two", force=True)
    assert file.read_bytes() == b"two"


def test_a_stream_of_the_shell_is_written(tmp_path: Path) -> None:
    ours, theirs_ = os.pipe()
    try:
        save_bytes(Path(f"/dev/fd/{theirs_}"), b"data", force=False)
        assert os.read(ours, 9) == b"data"
    finally:
        os.close(ours)
        os.close(theirs_)


@pytest.mark.parametrize("write", WAYS)
def test_no_write_waits_for_the_reader_of_a_pipe(
    tmp_path: Path, write: Callable[[Path], None]
) -> None:
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    with pytest.raises((StateError, OSError)) as refused:
        write(fifo)
    names(refused.value, "nobody reads", "start its reader")
    reader = os.open(fifo, os.O_RDONLY | os.O_NONBLOCK)
    try:
        write(fifo)
        assert fifo.is_fifo()
        assert os.read(reader, 9) == (b"new" if write is not grow else b"")
    finally:
        os.close(reader)
    write(Path("/dev/null"))
