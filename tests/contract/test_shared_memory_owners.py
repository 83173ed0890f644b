"""Who may have made the shared memory of a bus: a name in `/dev/shm` is no proof.

Each test has a `/dev/shm` of its own. Only root can be several users.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from conftest import names

PRELUDE = """
import contextlib, ctypes, os, signal, sys, traceback
from pathlib import Path
from test_shared_memory import make_bus
from ecatd.master.engine.process_image import lay_out
from ecatd.master.engine.shared_memory import SharedMemory
from ecatd.client import Client
from ecatd.base.errors import EcatError
from ecatd.shm.reader import opened
from ecatd.shm.files import folders, make_folder

libc = ctypes.CDLL(None)
MALLORY, ALICE = 54321, 54322
MACHINE = Path("/dev/shm/ecat")
bus = make_bus()
folders()[0].rmdir()  # of the import

def serve(folder):
    made = SharedMemory(bus.name, folder)
    made.fill(bus, lay_out(bus, set()), 5_000_000, 500_000_000)
    made.header.cycle_end_ns = 1 << 62
    made.publish()
    return made

def as_user(user, function):
    "Runs a function as another user, with the groups of this one."
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        try:
            os.setuid(user)
            libc.prctl(4, 1, 0, 0, 0)  # /proc/self is its own again
            function()
        except BaseException:
            traceback.print_exc()
            os._exit(1)
        sys.stdout.flush()
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0

def look():
    "What the clients in C and in Python say: the same about owners."
    said = []
    for client in (Client, opened):
        try:
            with contextlib.ExitStack() as stack:
                found = client(bus.name)
                if client is opened:
                    found = stack.enter_context(found)
                said.append("found")
        except EcatError as error:
            said.append(f"{type(error).__name__}: {error}")
    assert said[0] == said[1] or all("is not running" in text for text in said), said
    print(said[0])

def make():
    try:
        print(make_folder(lambda text: print("told", text)))
    except EcatError as error:
        print(f"{type(error).__name__}: {error}")

def put(kind, path):
    if kind == "fifo":
        os.mkfifo(path)
    elif kind == "file":
        path.touch()
    elif kind == "link":
        path.symlink_to("/tmp")
    else:
        path.mkdir()
        path.chmod(0o777)
        os.mkfifo(path / bus.name)
        (path / "deep").mkdir()
"""

only_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can be several users")
pytestmark = [pytest.mark.unprivileged, pytest.mark.timeout(60)]


def run(code: str, *arguments: str) -> list[str]:
    """The lines that a program prints in a mount namespace with an empty `/dev/shm`."""
    user = [] if os.geteuid() == 0 else ["--user", "--map-root-user"]
    script = (
        "mount -t tmpfs -o mode=1777 none /dev/shm; mkdir -p /run/user || true; "
        '! [ -d /run/user ] || mount -t tmpfs -o mode=755 none /run/user; exec "$@"'
    )
    python = [sys.executable, "-c", PRELUDE + code, *arguments]
    path = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    done = subprocess.run(
        ["unshare", *user, "--mount", "sh", "-ec", script, "sh", *python],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_a_daemon_makes_its_folder_and_a_client_finds_it() -> None:
    folder, mode, found, gone = run("""
os.umask(0)
folder = make_folder(print)
print(folder); print(oct(folder.stat().st_mode))
made = serve(folder)
look()
made.close()
look()
""")
    own = "/dev/shm/ecat" if os.geteuid() == 0 else f"/dev/shm/ecat-{os.geteuid()}"
    assert (folder, mode) == (own, "0o40755" if os.geteuid() == 0 else "0o40700")
    assert found == "found"
    names(gone, "UnreachableError", "not", "running")


@only_root
@pytest.mark.parametrize("kind", ["fifo", "file", "link", "directory"])
def test_what_a_stranger_puts_in_place_of_the_folder(kind: str) -> None:
    """Root removes it; a user who cannot is told whose it is, and nothing hangs."""
    told, folder, state, found, refused = run(
        """
kind = sys.argv[1]
as_user(MALLORY, lambda: put(kind, MACHINE))
make()
print(MACHINE.lstat().st_uid, oct(MACHINE.lstat().st_mode), list(MACHINE.iterdir()))
assert {path.name for path in Path("/dev/shm").iterdir()} == {"ecat"}
serve(MACHINE); look()
as_user(MALLORY, lambda: put(kind, Path(f"/dev/shm/ecat-{ALICE}")))
as_user(ALICE, make)
""",
        kind,
    )
    names(told, "/dev/shm/ecat", "54321", "removed")
    assert (folder, state, found) == ("/dev/shm/ecat", "0 0o40755 []", "found")
    names(refused, "NotPermittedError", "/dev/shm/ecat-54322", "54321", "sudo rm -r")


@only_root
@pytest.mark.parametrize("kind", ["fifo", "link", "directory"])
def test_a_user_whose_name_somebody_has_taken_goes_on_in_their_session(kind: str) -> None:
    told, folder, mode, found, gone, refused = run(
        """
session = Path(f"/run/user/{ALICE}")
session.mkdir(0o700)
os.chown(session, ALICE, ALICE)
as_user(MALLORY, lambda: put(sys.argv[1], Path(f"/dev/shm/ecat-{ALICE}")))

def simulate():
    make()
    made = serve(make_folder(lambda told: None))
    print(oct((session / "ecat").stat().st_mode))
    look()
    made.close()
    look()

as_user(ALICE, simulate)
os.chown(session / "ecat", MALLORY, MALLORY)
as_user(ALICE, make)
""",
        kind,
    )
    names(told, "/dev/shm/ecat-54322", "54321", "sudo rm -r", "/run/user/54322/ecat")
    assert (folder, mode, found) == ("/run/user/54322/ecat", "0o40700", "found")
    names(gone, "NotPermittedError" if kind != "link" else "/dev/shm/ecat-54322", "54321")
    names(refused, "NotPermittedError", "/dev/shm/ecat-54322", "54321", "sudo rm -r")


@only_root
def test_an_invented_bus_is_not_believed() -> None:
    elsewhere, *said, named, wrong = run("""
def invent(folder):
    folder.mkdir(exist_ok=True)
    serve(folder)
    os.umask(0)
    folder.chmod(0o755)
    for path in folder.iterdir():
        path.chmod(0o666)

def linger(folder):
    "The daemon of Mallory, with its lock."
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        os.setuid(MALLORY)
        invent(folder)
        os.write(write, b"x")
        signal.pause()
    os.read(read, 1)
    return child

first, second = linger(Path(f"/dev/shm/ecat-{MALLORY}")), linger(MACHINE)
try:
    as_user(MALLORY, look)
    look()
    as_user(ALICE, look)
    # Folder of root, file of Mallory.
    os.chown(MACHINE, 0, 0)
    look()
    os.environ["ECAT_TRUSTED_OWNER"] = str(MALLORY)
    look()
    for path in MACHINE.iterdir(): path.unlink()
    look()
    os.environ["ECAT_TRUSTED_OWNER"] = "nobody"
    look()
    os.environ["ECAT_TRUSTED_OWNER"] = "no-such-user"
    look()
finally:
    os.kill(first, 9); os.kill(second, 9)
""")
    assert elsewhere == "found"
    folder, member, file, trusted, own = said
    for text in (folder, member):
        names(text, "NotPermittedError", "/dev/shm/ecat belongs", "54321", "ECAT_TRUSTED_OWNER=")
    names(file, "NotPermittedError", "54321", "ECAT_TRUSTED_OWNER=54321")
    assert "/dev/shm/ecat/s" in file
    assert (trusted, own) == ("found", "found")
    names(named, "UnreachableError")
    names(wrong, "UsageError", "ECAT_TRUSTED_OWNER", "no-such-user", "getent passwd")


@only_root
def test_a_folder_that_others_can_write_is_not_believed_and_mended() -> None:
    refused, folder, mode, found = run("""
made = serve(make_folder(print))
MACHINE.chmod(0o777)
look()
make()
print(oct(MACHINE.stat().st_mode))
look()
""")
    names(refused, "NotPermittedError", "write", "chmod go-w /dev/shm/ecat")
    assert (folder, mode, found) == ("/dev/shm/ecat", "0o40755", "found")


@only_root
@pytest.mark.parametrize("kind", ["fifo", "link", "directory"])
def test_only_a_regular_file_is_a_bus(kind: str) -> None:
    (said,) = run("put(sys.argv[1], make_folder(print) / bus.name); look()", kind)
    assert said.startswith(("StateError", "NotPermittedError"))
    assert "/dev/shm/ecat/s" in said


@only_root
def test_a_container_in_which_the_owner_has_no_number() -> None:
    """The kernel shows 65534, which is no proof of anything: also a client may be 65534."""
    lines = run("""
folder = make_folder(print)
made = serve(folder)
for path in (folder, *folder.iterdir()):
    os.chown(path, MALLORY, 0)
    path.chmod(path.stat().st_mode | 0o004)
def within(users):
    assert libc.unshare(0x10000000) == 0
    if users:
        Path("/proc/self/uid_map").write_text(users)
    for setting in ("", "65534"):
        os.environ["ECAT_TRUSTED_OWNER"] = setting
        look()

for users in ("0 0 1", "1000 0 1", ""):
    as_user(0, lambda: within(users))
""")
    assert lines[1::2] == ["found"] * 3
    for text in lines[::2]:
        names(text, "NotPermittedError", "65534", "container", "ECAT_TRUSTED_OWNER=65534")


@only_root
def test_a_client_never_goes_over_to_a_bus_of_the_same_name_elsewhere() -> None:
    """As from a simulated rig to the machine: an own bus comes first, and both stay apart."""
    first, after, other = run("""
made = serve(make_folder(print))  # of the machine

def simulate():
    own = serve(make_folder(print))
    with opened(bus.name) as shared:
        print(shared.path)
    client = Client(bus.name)
    client.sample()
    own.close()
    import time
    time.sleep(0.1)  # longer than the pause between two attempts
    try:
        client.sample()
        print("it is another bus now")
    except EcatError as error:
        print(error)
    with opened(bus.name) as shared:
        print(shared.path)

as_user(ALICE, simulate)
""")
    assert first.startswith("/dev/shm/ecat-54322/s")
    names(after, "daemon", "bus")
    assert "another bus" not in after
    assert other.startswith("/dev/shm/ecat/s")


@only_root
def test_root_in_a_namespace_of_one_user_has_the_folder_of_that_user() -> None:
    lines = run("""
from ecatd.base.network_namespace import enter_new
from ecatd.base.paths import user_dir
os.environ.pop("ECATD_RUNTIME_DIR", None)
os.environ.pop("XDG_RUNTIME_DIR", None)
def show():
    print(os.geteuid(), *folders(), user_dir())
def enter():
    show(); enter_new(); show()
as_user(ALICE, enter)
as_user(0, enter)
""")
    alice = "/dev/shm/ecat-54322 /run/user/54322/ecat /dev/shm/ecat /tmp/ecatd-54322"
    root = "/dev/shm/ecat /run/ecatd"
    assert lines == [f"54322 {alice}", f"0 {alice}", f"0 {root}", f"0 {root}"]
