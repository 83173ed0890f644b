"""The audit file: each change that somebody asks for, with who, what, and the values."""

from __future__ import annotations

import hashlib
import itertools
import re
import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import pytest

from conftest import Daemon, names, run_module, wait_for
from ecatd.base.errors import EcatError, NoAnswerError, SdoAbortError, StateError
from ecatd.client.remote import Remote
from ecatd.etg.al import AlState
from ecatd.etg.idns import parse_idn
from ecatd.operations.bus import SetState
from ecatd.operations.catalog import OPERATIONS
from ecatd.operations.eeproms import WriteSii
from ecatd.operations.ethernet import WriteIp
from ecatd.operations.files import CancelFoe, PutFoe, StartFoe
from ecatd.operations.frames import ReadFrames
from ecatd.operations.idns import WriteIdn
from ecatd.operations.incidents import DeleteIncident, ReadIncident, RecordIncident
from ecatd.operations.log import SetLogLevel
from ecatd.operations.objects import SdoWrite
from ecatd.operations.operation import Operation
from ecatd.operations.outputs import HoldOutputs, ReleaseOutputs
from ecatd.operations.registers import ReadErrors, ResetErrors, WriteRegister
from ecatsim.control import Simulator
from rigs.everything import IDN, TEXT

RIG = Path(__file__).parents[1] / "rigs" / "everything.py"
BY = "test (pid 812, uid 1000)"
WHO = f"somebody on this machine [{BY}]"

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]


def reload(daemon: Daemon, file: Path) -> None:
    daemon.config_file.write_text(f'audit_file = "{file}"\n[gateway]\nlisten = []\n')
    before = daemon.log.count("configuration read again")
    daemon.process.send_signal(1)
    wait_for(lambda: daemon.log.count("configuration read again") > before, daemon)


def test_each_change_is_in_the_file(start_daemon: Callable[..., Daemon], tmp_path: Path) -> None:
    file, rotated = tmp_path / "audit", tmp_path / "audit.1"
    config = f'audit_file = "{file}"\n[gateway]\nlisten = []\n'
    daemon = start_daemon("troll", config=config)
    before = daemon.ctl_json("sdo-read", "0", "0x6083", "0")["value"]
    daemon.ctl("sdo-write", "0", "0x6083", "0", "1234")
    daemon.ctl("state", "4", "SAFEOP", "--yes")
    daemon.ctl("sdo-write", "0", "0x1018", "1", "7", check=False)  # is refused
    daemon.ctl("sdo-read", "0", "0x6083", "0")
    first, second, refused = file.read_text().splitlines()
    names(first, daemon.bus, "slave 0", "0x6083:00", before, "1234", "pid", "uid")
    names(second, daemon.bus, "slave 4", "from OP to SAFEOP")
    names(refused, "slave 0", "0x1018:01", "to 7", "has failed", "SDO abort 0x06010002")
    assert re.match(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}[+-]\d{4} ", first)
    assert file.stat().st_mode & 0o007 == 0
    file.rename(rotated)
    daemon.ctl("state", "4", "OP")
    (third,) = file.read_text().splitlines()
    names(third, "slave 4", "OP")
    # A file that cannot be written is an error of its own, told once; changes go on.
    reload(daemon, tmp_path)
    for level in ("debug", "info"):
        daemon.ctl("log-level", "dc", level)
    assert daemon.log.count("audit_file") == 1 + daemon.log.count("changed: audit_file")
    names(daemon.log, str(tmp_path), "Is a directory")
    reload(daemon, file)
    daemon.ctl("log-level", "dc", "debug")
    assert len(file.read_text().splitlines()) == 2
    assert len(rotated.read_text().splitlines()) == 3


def test_a_folder_that_does_not_exist(start_daemon: Callable[..., Daemon], tmp_path: Path) -> None:
    missing = tmp_path / "nowhere"
    config = f'audit_file = "{missing / "audit"}"\n[gateway]\nlisten = []\n'
    daemon = start_daemon("troll", config=config)
    file = str(daemon.config_file)
    (line,) = [line for line in daemon.log.splitlines() if "audit_file" in line]
    names(line, "warning", f"{file}:1: audit_file", missing, "make it")
    (warning,) = daemon.ctl_json("config", "check", file)["warnings"]
    assert warning in line
    alone = run_module("ecatd.service", "--check-config", "--config", file)
    assert (alone.returncode, warning in alone.stderr) == (0, True)
    missing.mkdir()
    assert daemon.ctl_json("config", "check", file)["warnings"] == []
    daemon.ctl("log-level", "dc", "debug")
    assert (missing / "audit").exists()


class Site(NamedTuple):
    """A daemon with an audit file, a client of it, and its simulated segment."""

    daemon: Daemon
    file: Path
    remote: Remote
    simulator: Simulator

    def ask(self, *requests: Operation) -> list[str]:
        """The new lines of the audit file after some requests."""
        before = len(self.lines())
        for request in requests:
            self.remote.request(request)
        return self.lines()[before:]

    def refused(self, kind: type[EcatError], request: Operation) -> str:
        """The new line after a request that fails."""
        before = len(self.lines())
        with pytest.raises(kind):
            self.remote.request(request)
        (line,) = self.lines()[before:]
        return line

    def lines(self) -> list[str]:
        return self.file.read_text().splitlines() if self.file.exists() else []


@contextmanager
def connected(daemon: Daemon, file: Path) -> Iterator[Site]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ECATD_RUNTIME_DIR", daemon.env["ECATD_RUNTIME_DIR"])
        with (
            Remote(daemon.bus, timeout=60) as remote,
            Simulator(str(daemon.child_pid("ecatsim"))) as simulator,
        ):
            yield Site(daemon, file, remote, simulator)


def with_a_file(start: Callable[..., Daemon], file: Path) -> Daemon:
    return start(str(RIG), config=f'audit_file = "{file}"\n[gateway]\nlisten = []\n')


@pytest.fixture
def site(start_daemon: Callable[..., Daemon], tmp_path: Path) -> Iterator[Site]:
    """A site for a test that ends its daemon, or leaves slaves that do not answer."""
    with connected(with_a_file(start_daemon, tmp_path / "audit"), tmp_path / "audit") as made:
        yield made


@pytest.fixture(scope="module")
def running(
    start_shared: Callable[..., Daemon], tmp_path_factory: pytest.TempPathFactory
) -> tuple[Daemon, Path]:
    file = tmp_path_factory.mktemp("shared") / "audit"
    return with_a_file(start_shared, file), file


@pytest.fixture
def shared_site(running: tuple[Daemon, Path]) -> Iterator[Site]:
    """A site with a new file of a daemon that other tests use as well."""
    daemon, file = running
    file.unlink(missing_ok=True)
    with connected(daemon, file) as made:
        yield made


CHANGES: dict[type[Operation], tuple[Operation, str, Sequence[str]]] = {
    SetState: (
        SetState("SAFEOP", 1, BY),
        "slave 1 (CiA402), AL state: changed",
        ("from OP to SAFEOP",),
    ),
    SetLogLevel: (
        SetLogLevel("debug", "dc", BY),
        "log level of dc changed",
        ("from info to debug",),
    ),
    SdoWrite: (
        SdoWrite(0, 0x6083, struct.pack("<I", 1234), by=BY),
        "slave 0 (CiA402), 0x6083:00 (Profile acceleration): changed",
        ("from ", " to 1234 "),
    ),
    WriteRegister: (
        WriteRegister(0, 0x0400, b"\xc3\x09", BY),
        "slave 0 (CiA402), register 0x0400",
        ("from c2 09 to c3 09",),
    ),
    ResetErrors: (
        ResetErrors(0, BY),
        "error counters of slave 0 (CiA402): cleared by ",
        ("; before: slave 0: port 0: 3 invalid",),
    ),
    WriteSii: (
        WriteSii(0, 0x0004, b"\x07\x00", by=BY),
        "slave 0 (CiA402), EEPROM words 0x0004: changed",
        ("from 00 00 to 07 00",),
    ),
    WriteIp: (
        WriteIp(0, address="192.168.7.2/24", by=BY),
        "slave 0 (CiA402), IP parameters: changed",
        ("from ", "to ", "192.168.7.2/24"),
    ),
    WriteIdn: (
        WriteIdn(0, parse_idn(IDN), b"\x01\0\0\0", by=BY),
        f"slave 0 (CiA402), drive 0, {IDN} (Position): changed",
        ("from 18 fc ff ff to 01 00 00 00",),
    ),
    StartFoe: (
        StartFoe(0, "empty.txt", True, 0, hashlib.sha256().hexdigest(), by=BY),
        "slave 0 (CiA402): writing file 'empty.txt' begins",
        ("0 bytes", f"SHA-256 {hashlib.sha256().hexdigest()}"),
    ),
}
"""A request of each kind, how its line begins, and what else is in the line."""

APART = {PutFoe, CancelFoe, HoldOutputs, ReleaseOutputs, RecordIncident, DeleteIncident}
"""Kinds that others need before or after them: they are in tests of their own, those of outputs in
`test_outputs_by_hand.py`, those of incidents in `test_incidents.py`."""
NO_CHANGE = {ReadFrames, ReadIncident}


def test_each_kind_of_change_has_a_line(shared_site: Site) -> None:
    kinds = {kind for kind in OPERATIONS.values() if kind.key.startswith("rw/")}
    assert kinds == CHANGES.keys() | APART | NO_CHANGE
    assert {kind for kind in kinds if "by" not in kind.fields} == {PutFoe} | NO_CHANGE
    shared_site.simulator.faults.noise(0, count=3)
    wait_for(
        lambda: shared_site.remote.request(ReadErrors())["slaves"][0]["ports"][0]["invalid"] == 3,
        shared_site.daemon,
    )
    for kind, (request, begin, tokens) in CHANGES.items():
        line, *more = shared_site.ask(request)
        assert f" {shared_site.daemon.bus}: {begin}" in line
        names(line, WHO, *tokens)
        assert not more or kind is StartFoe
        assert line.split(": ", 1)[1] in shared_site.daemon.log
    wait_for(lambda: "is done" in shared_site.lines()[-1], shared_site.daemon)  # the file
    assert shared_site.ask(ReadFrames("control")) == []


def test_incidents_that_are_asked_for_and_deleted_have_lines(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    pytest.importorskip("mcap")
    file, folder = tmp_path / "audit", tmp_path / "incidents"
    config = (
        f'audit_file = "{file}"\n[gateway]\nlisten = []\n[flight_recorder]\n'
        f'folder = "{folder}"\nbefore_s = 0.2\nafter_s = 0.2\n'
    )
    daemon = start_daemon("line:1", config=config)
    name = daemon.ctl_json("incident", "record", "a", "noise")["name"]
    daemon.ctl("incident", "record")
    daemon.ctl("incident", "delete", name)
    wait_for(lambda: len(file.read_text().splitlines()) == 3, daemon)
    first, second, third = (
        line.split(f"{daemon.bus}: ")[1] for line in file.read_text().splitlines()
    )
    assert first.startswith("an incident about 'a noise': asked for by somebody on this machine [")
    assert second.startswith("an incident: asked for by somebody on this machine [")
    assert third.startswith(f"incident {name}: deleted by somebody on this machine [")


def test_a_refused_object_has_its_start_up_value_beside_it(
    start_daemon: Callable[..., Daemon], tmp_path: Path
) -> None:
    file = tmp_path / "audit"
    config = (
        f'audit_file = "{file}"\n[gateway]\nlisten = []\n[[slave]]\nposition = 0\n'
        '[[slave.startup]]\nobject = "0x6065:00"\ntype = "uint32"\nvalue = 5000\n'
    )
    daemon = start_daemon("troll", config=config)
    daemon.ctl("sdo-write", "0", "0x6065", "0", "--type", "uint64", "7", check=False)
    (line,) = file.read_text().splitlines()
    names(line, "0x6065:00", "has failed", "; the start-up list has 5000 for it")


def test_files_are_named_with_length_and_digest(shared_site: Site) -> None:
    data = bytes(range(256)) * 4
    digest = hashlib.sha256(data).hexdigest()
    start = StartFoe(0, "new.bin", True, len(data), digest, by=BY)
    number = shared_site.remote.request(start)["transfer"]
    cancelled = shared_site.ask(CancelFoe(number, BY))
    assert len(cancelled) == 1
    names(cancelled[0], "writing file 'new.bin'", "cancelled", WHO)
    number = shared_site.remote.request(start)["transfer"]
    assert len(shared_site.lines()) == 1  # nothing has reached the slave
    shared_site.remote.request(PutFoe(number, 0, data))
    wait_for(lambda: len(shared_site.lines()) == 3, shared_site.daemon)
    for line, word in zip(shared_site.lines()[1:], ("begins", "is done"), strict=True):
        names(line, "slave 0", "writing file 'new.bin'", word, "1024 bytes", digest, WHO)
    shared_site.ask(StartFoe(0, "new.bin", by=BY))
    wait_for(lambda: len(shared_site.lines()) == 5, shared_site.daemon)
    names(shared_site.lines()[4], "reading file 'new.bin'", "is done", "1024 bytes", digest, WHO)
    shared_site.ask(StartFoe(0, "nothing", by=BY))
    wait_for(lambda: len(shared_site.lines()) == 7, shared_site.daemon)
    names(shared_site.lines()[6], "reading file 'nothing'", "has failed", "0x8001", WHO)
    names(shared_site.daemon.log, f"warning: {shared_site.lines()[6].split(': ', 1)[1]}")


def test_the_end_of_the_bus_ends_a_transfer_with_a_line(site: Site) -> None:
    transfer = site.remote.start_file_write(0, "big.bin", bytes(3_000_000))
    while not site.lines():
        transfer.send()
    assert site.daemon.stop() == 0
    begins, ends = site.lines()
    names(begins, "writing file 'big.bin'", "begins", "3000000 bytes", "somebody on this machine")
    names(ends, "writing file 'big.bin'", "has failed", "somebody on this machine")


def test_long_values_have_length_and_digest(shared_site: Site) -> None:
    old, new = b"a" * 33, b"b" * 600
    shared_site.ask(SdoWrite(0, TEXT, old, by=BY))
    (line,) = shared_site.ask(SdoWrite(0, TEXT, new, by=BY))
    for data, begin in ((old, "from 61 61"), (new, "to 62 62")):
        digest = hashlib.sha256(data).hexdigest()
        names(line, begin, f"{len(data)} bytes, SHA-256 {digest}")


@pytest.mark.long
def test_what_fails_has_a_line_too(site: Site) -> None:
    refused = site.refused(SdoAbortError, SdoWrite(0, 0x1018, b"\0\0\0\0", 1, by=BY))
    names(refused, "0x1018:01", "to 0", "has failed", "0x06010002", WHO)
    idn = WriteIdn(0, parse_idn("S-0-0099"), b"\0", by=BY)
    names(site.refused(StateError, idn), "S-0-0099", "to 00", "has failed", WHO)
    site.simulator.faults.mailbox(0, "slow", delay_s=3600)
    for request in (
        SdoWrite(0, 0x6083, b"\1\0\0\0", by=BY),
        WriteIdn(0, parse_idn(IDN), b"\2\0\0\0", by=BY),
        WriteIp(0, address="192.168.7.9/24", by=BY),
    ):
        names(site.refused(NoAnswerError, request), "slave 0", "may have been made", WHO)
    site.simulator.faults.power_off(1)
    wait_for(lambda: site.daemon.slave_rows("state")[1]["al_state"] == 0, site.daemon)
    sii = site.refused(EcatError, WriteSii(1, 0x0004, b"\x07\x00", by=BY))
    names(sii, "slave 1", "EEPROM words 0x0004", "to 07 00", "has failed", WHO)
    for kind, request in (
        (NoAnswerError, WriteRegister(1, 0x0400, b"\0\0", BY)),
        (NoAnswerError, ResetErrors(1, BY)),
        (StateError, SetState("OP", 1, BY)),
    ):
        names(site.refused(kind, request), "slave 1", WHO)


def test_changes_through_shared_memory_are_told_together(site: Site) -> None:
    """A model that writes an object at each sample neither floods the log nor is left out."""
    many = 50
    with site.daemon.client() as client:
        for value in range(many):
            client.sdo_download(0, 0x6083, 0, struct.pack("<I", 5000 + value)).result()
        client.request_state(1, AlState.SAFEOP).result()
        with pytest.raises(SdoAbortError):
            client.sdo_download(0, 0x1018, 1, bytes(4)).result()
    assert site.daemon.stop() == 0
    lines = site.lines()
    names(lines[0], "slave 0", "0x6083:00", "from", "the program in slot", "pid")
    written = [line for line in lines if "0x6083:00" in line]
    assert len(written) <= many // 5
    counts = [re.search(r"changed (\d+) times, ", line) for line in written]
    assert sum(int(found[1]) if found else 1 for found in counts) == many
    ends = [re.search(r"from (\d+) to (\d+) by", line) for line in written]
    pairs = [(int(found[1]), int(found[2])) for found in ends if found]
    assert len(pairs) == len(written)
    assert all(end == begin for (_, end), (begin, _) in itertools.pairwise(pairs))
    assert pairs[-1][1] == 5000 + many - 1
    (state,) = [line for line in lines if "AL state" in line]
    names(state, "slave 1", "from OP to SAFEOP", "the program in slot")
    (refused,) = [line for line in lines if "0x1018:01" in line]
    names(refused, "has failed", "0x06010002", "the program in slot")
