"""Runs tests, ends what they leave behind, and fails if there was anything: `guard.py COMMAND`.

What a test starts must end with it, also if it fails, takes too long or is killed. There are two
processes, and both adopt whatever loses its parent (PR_SET_CHILD_SUBREAPER), so nothing gets away
from them. If one of them is killed, the other one ends all.
"""

import contextlib
import ctypes
import json
import os
import pwd
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

RUNNING = "ECATD_TEST"
"""In the environment of what a test starts: the name of the test."""
DIARY = "ECATD_TEST_DIARY"
"""A file in which the tests write what exists whenever one of them begins or ends."""
EXIT_STATUS = 9
_LIBC = ctypes.CDLL(None)
_PR_SET_PDEATHSIG, _PR_SET_CHILD_SUBREAPER = 1, 36
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_PATIENCE_S = float(os.environ.get("ECATD_TEST_PATIENCE_S", "5"))  # for what is ending already
_NAMES = ("ecat", "sim", "esc")  # of interfaces
_NOBODY = 65534


class Things(NamedTuple):
    """What the kernel keeps when a process ends.

    Others may use the machine meanwhile, so only names that tests use are looked at.

    Attributes:
        files: Shared memory.
        interfaces: Network interfaces of this namespace.
        namespaces: Named network namespaces.
    """

    files: frozenset[str]
    interfaces: frozenset[str]
    namespaces: frozenset[str]

    @staticmethod
    def now() -> "Things":
        """What there is."""
        named = Path("/run/netns")
        return Things(
            frozenset(map(str, filter(_is_ours, Path("/dev/shm").glob("ecat*/*")))),
            frozenset(name for _, name in socket.if_nameindex() if name.startswith(_NAMES)),
            frozenset(map(str, named.glob("ecat*")) if named.is_dir() else ()),
        )

    def since(self, before: "Things") -> list[tuple[str, str]]:
        """What is new and belongs to no process: kind and name."""
        files = self.files - before.files
        if files:
            files -= _files_in_use()
        return [
            *(("shared memory", name) for name in sorted(files)),
            *(("interface", name) for name in sorted(self.interfaces - before.interfaces)),
            *(("network namespace", name) for name in sorted(self.namespaces - before.namespaces)),
        ]


def _is_ours(path: Path) -> bool:
    """Whether shared memory can be of the tests: other users may run ecatd beside them.

    Tests that root runs also use numbers of users that no account has.
    """
    try:
        owner = path.lstat().st_uid
    except OSError:  # it has just gone, or lies where only another user may look
        return False
    return owner == os.getuid() or (os.getuid() == 0 and not _has_account(owner))


def _has_account(user: int) -> bool:
    try:
        return user != _NOBODY and bool(pwd.getpwuid(user))
    except KeyError:
        return False


def _files_in_use() -> set[str]:
    """The files that any process has open, and the shared memory that any process has mapped."""
    found = set()
    for link in Path("/proc").glob("[0-9]*/fd/*"):
        with contextlib.suppress(OSError):
            found.add(str(link.readlink()))
    for maps in Path("/proc").glob("[0-9]*/maps"):
        with contextlib.suppress(OSError):
            found.update(re.findall(r"/dev/shm/.+$", maps.read_text(), re.MULTILINE))
    return found


def note(what: str, test: str) -> None:
    """Writes into the diary that a test begins or ends; this takes some 0.1 ms."""
    if path := os.environ.get(DIARY):
        line = json.dumps([what, test, [sorted(names) for names in Things.now()]])
        with Path(path).open("a") as diary:
            diary.write(line + "\n")


def suspects(diary: Iterable[str], name: str) -> list[str]:
    """The tests that were running when something was first seen."""
    running: list[str] = []
    for line in diary:
        what, test, things = json.loads(line)
        if any(name in names for names in things):
            return running or [test]  # one that only begins has not made it
        if what == "begin":
            running.append(test)
        else:
            running.remove(test)
    return running


def descendants() -> Iterator[tuple[int, str, str]]:
    """Processes below this one: number, name of the test that started it, command line."""
    parents = {}
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            after_name = (folder / "stat").read_text().rpartition(")")[2].split()
            if after_name[0] != "Z":
                parents[int(folder.name)] = int(after_name[1])
    for pid in parents:
        above = pid
        while above in parents and above != os.getpid():
            above = parents[above]
        if above == os.getpid() and pid != above:
            with contextlib.suppress(OSError):
                environment = Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")
                begin = f"{RUNNING}=".encode()
                tests = [x[len(begin) :].decode() for x in environment if x.startswith(begin)]
                command = Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
                yield pid, tests[0] if tests else "a test", command.strip()[:120]


def _reap() -> None:
    with contextlib.suppress(ChildProcessError):
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass


def end_processes() -> list[str]:
    """Kills what still runs after some patience; says what it was."""
    end = time.monotonic() + _PATIENCE_S
    while (left := list(descendants())) and time.monotonic() < end:
        _reap()
        time.sleep(0.05)
    for pid, _, _ in left:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    while any(descendants()):
        time.sleep(0.05)
    _reap()
    return [f"process {pid} ({command}), started by {test}" for pid, test, command in left]


def remaining(before: Things) -> list[tuple[str, str]]:
    """What is new and stays: other runs of the tests may make and remove such things meanwhile."""
    found = Things.now().since(before)
    end = time.monotonic() + _PATIENCE_S
    while found and time.monotonic() < end:
        time.sleep(0.2)
        found = [thing for thing in Things.now().since(before) if thing in found]
    return found


def _die_with_parent(number: int) -> None:
    _LIBC.prctl(_PR_SET_PDEATHSIG, number, 0, 0, 0)


def _adopt() -> None:
    _LIBC.prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def _tell(left: list[str]) -> None:
    for line in left:
        print(f"left behind: {line}", file=sys.stderr, flush=True)


def main(command: list[str]) -> int:
    """Runs a command; its exit status, or 9 if it succeeded and left something behind."""
    _adopt()
    keeper = os.fork()
    if keeper == 0:
        _die_with_parent(signal.SIGTERM)
        status = EXIT_STATUS
        try:
            status = _keep(command)
        except BaseException:
            traceback.print_exc()
        os._exit(status % 256)

    def pass_on(number: int, _frame: object) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.kill(keeper, number)

    for number in _SIGNALS:
        signal.signal(number, pass_on)
    status = os.waitstatus_to_exitcode(os.waitpid(keeper, 0)[1])
    if status >= 0:
        return status
    _tell(end_processes())
    return EXIT_STATUS


def _keep(command: list[str]) -> int:
    """Runs a command and ends what it leaves behind; returns as `main`."""
    _adopt()
    # A signal that comes while the command starts waits until it can be passed on.
    signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)

    def begin() -> None:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)
        _die_with_parent(signal.SIGKILL)

    before = Things.now()
    with tempfile.NamedTemporaryFile("r", prefix="ecatd-tests-") as diary:
        process = subprocess.Popen(
            command,
            env={**os.environ, DIARY: diary.name},
            preexec_fn=begin,
        )
        for number in _SIGNALS:
            signal.signal(number, lambda number, _: process.send_signal(number))
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)
        status = process.wait()
        left = end_processes()
        lines = diary.readlines()
        for kind, name in remaining(before):
            names = " or ".join(suspects(lines, name)) or "a test"
            left.append(f"{kind} {name}, left by {names}")
    _tell(left)
    return status if status or not left else EXIT_STATUS


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
