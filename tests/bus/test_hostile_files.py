"""Files of the shared memory are damaged, removed or replaced: the bus goes on, and it is told."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from conftest import SHM, Daemon, wait_for
from ecatd.client import Client, Reason
from ecatd.shm import contract as shm
from handle import EBUSY, ELAYOUT, ELEASE, Handle

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged, pytest.mark.long]


@pytest.fixture
def daemon(start_daemon: Callable[..., Daemon]) -> Daemon:
    return start_daemon("line:4")


def out_of(daemon: Daemon) -> Path:
    return SHM / f"{daemon.bus}.out"


def check_goes_on(reader: Client, daemon: Daemon) -> None:
    """Cycles with all slaves go on, as whoever is connected sees."""
    seen = set()

    def complete() -> bool:
        reader.wait(timeout=30)
        reader.sample()
        if reader.domain().wkc_state == shm.WkcState.COMPLETE:
            seen.add(reader.cycle)
        return len(seen) > 20

    wait_for(complete, daemon)


def check_writable(daemon: Daemon) -> None:
    """A new client can own outputs, and what it writes goes out."""
    with Handle(daemon.bus) as writer:
        output = writer.bind(0, 0x7000, 1, 1)
        assert writer.claim(0, 30.0) == 0, writer.error
        assert writer.write(output, 77.0) == 0
        assert writer.commit() == 0

        def arrived() -> bool:
            return writer.wait(1, 30.0) == 0 and writer.sample() == 0 and writer.value(output) == 77

        wait_for(arrived, daemon)


def told(daemon: Daemon, path: Path, damage: str) -> None:
    """The log names file and damage, and who has the file open: this process, if anybody."""
    wait_for(lambda: f"{path} was {damage} by another process" in daemon.log, daemon)


@pytest.mark.parametrize("size", [0, 10, 4096, 8200])
def test_r29_a_file_that_is_cut_short_is_mended(daemon: Daemon, size: int) -> None:
    out = out_of(daemon)
    whole = out.stat().st_size
    with daemon.client() as reader, out.open("r+b") as file:
        file.truncate(size)
        told(daemon, out, "cut short")
        if os.geteuid() == 0:  # others may not know who has a file open
            assert f"(pid {os.getpid()})" in daemon.log
        wait_for(lambda: out.stat().st_size == whole, daemon)
        check_goes_on(reader, daemon)
        check_writable(daemon)
    assert daemon.stop() == 0


def test_clients_in_a_file_that_was_cut_short_begin_anew(
    start_daemon: Callable[..., Daemon],
) -> None:
    """Claims end, for no reason of theirs, and requests are answered again."""
    daemon = start_daemon("troll")
    out = out_of(daemon)
    whole = out.stat().st_size
    with daemon.client() as eye, Handle(daemon.bus) as owner, Handle(daemon.bus) as asker:
        lamp = eye.signal(3, 0x7000, 1)
        eye.sample()
        assert owner.claim(3, 30.0) == 0
        running = asker.sdo_start(0, 0x1018, 1, None, 0)
        assert asker.wait_request(running, 30.0) == 0
        os.truncate(out, 0)
        wait_for(lambda: out.stat().st_size == whole, daemon)
        wait_for(lambda: eye.output(lamp).owner is None, daemon)
        assert eye.output(lamp).reason is Reason.GONE
        assert owner.commit() == ELEASE
        request = asker.sdo_start(0, 0x1018, 1, None, 0)
        assert request >= 0
        assert asker.wait_request(request, 30.0) == 0
        assert asker.poll(request, None, 0, None, None) == 0
        assert owner.claim(3, 30.0) == 0
        # What runs while that happens ends with an error.
        request = asker.sdo_start(0, 0x1018, 1, None, 0)
        os.truncate(out, 0)
        wait_for(lambda: out.stat().st_size == whole, daemon)
        assert asker.wait_request(request, 30.0) == 0
        code = asker.poll(request, None, 0, None, None)
        assert code in (0, ELAYOUT), code  # it may have been answered before
        assert code == 0 or "written over" in asker.error
        assert asker.poll(request, None, 0, None, None) not in (0, EBUSY)


def test_r29_a_header_that_is_written_over_is_mended(daemon: Daemon) -> None:
    out = out_of(daemon)
    right = out.read_bytes()[:48]
    with daemon.client() as reader:
        with out.open("r+b") as file:
            file.write(os.urandom(48))
        with Handle(daemon.bus) as early:  # before it is mended, unless that is done already
            assert early.claim(0, 30.0) in (0, ELAYOUT)
        told(daemon, out, "written over")
        assert out.read_bytes()[:48] == right
        check_goes_on(reader, daemon)
        check_writable(daemon)
    assert daemon.stop() == 0


@pytest.mark.parametrize("suffix", ["", ".out"])
def test_rights_that_are_changed_are_mended(daemon: Daemon, suffix: str) -> None:
    path = SHM / f"{daemon.bus}{suffix}"
    before = path.stat().st_mode
    with daemon.client() as reader:
        path.chmod(0)
        told(daemon, path, "given other rights")
        assert path.stat().st_mode == before
        check_goes_on(reader, daemon)
        check_writable(daemon)
    assert daemon.stop() == 0


@pytest.mark.parametrize("kind", ["removed", "symlink", "fifo", "directory", "file"])
@pytest.mark.parametrize("suffix", ["", ".out"])
def test_who_is_connected_goes_on_without_a_name(
    daemon: Daemon, suffix: str, kind: str, tmp_path: Path
) -> None:
    path = SHM / f"{daemon.bus}{suffix}"
    with daemon.client() as reader, Handle(daemon.bus) as writer:
        assert writer.claim(0, 30.0) == 0
        output = writer.bind(0, 0x7000, 1, 1)
        path.unlink()
        match kind:
            case "symlink":
                path.symlink_to(tmp_path / "elsewhere")
            case "fifo":
                os.mkfifo(path)
            case "directory":
                path.mkdir()
            case "file":
                path.write_bytes(bytes(1 << 16))
        told(daemon, path, "removed" if kind == "removed" else "replaced")
        check_goes_on(reader, daemon)
        assert writer.claim(0, 30.0) == 0
        assert writer.write(output, 5.0) == 0
        assert writer.commit() == 0

        def arrived() -> bool:
            return writer.wait(1, 30.0) == 0 and writer.sample() == 0 and writer.value(output) == 5

        wait_for(arrived, daemon)
        # Who comes now is told something, and does not wait for ever.
        if suffix:
            with Handle(daemon.bus) as late:
                assert late.claim(1, 30.0) < 0
                assert late.error
        else:
            with pytest.raises(AssertionError):
                Handle(daemon.bus)
        assert daemon.slave_rows("slaves")
        assert daemon.stop() == 0
        # What is not the daemon's, it leaves alone.
        assert path.exists() == (kind != "removed") or path.is_symlink()
        if kind == "directory":
            path.rmdir()
        else:
            path.unlink(missing_ok=True)
