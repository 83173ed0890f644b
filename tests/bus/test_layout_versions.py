"""Daemons and clients of different versions of the layout: what fits works, the rest is told."""

import os
import shutil
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from conftest import SHM, Daemon, names, one_line_error, run_module, wait_for
from ecatd.base.errors import StateError
from ecatd.base.file_locks import take
from ecatd.base.version import VERSION
from ecatd.client import Client
from ecatd.shm import contract as shm
from ecatd.shm import raw
from ecatd.shm.contents import contents, read_outputs
from ecatd.shm.statistics import read
from ecatd.shm.statistics.clocks import read_clocks
from handle import Handle

pytestmark = [pytest.mark.bus, pytest.mark.long]

ROOT = Path(__file__).parents[2]
EL1018, EL2008 = 2, 3
LATER = shm.LAYOUT + 1
FILLING = 0xA5


# --- a segment of a later minor version, made of one of this version ------------------------------


def later_segment(data: bytes) -> bytes:
    """The same bus as a later minor version would lay it out.

    Header and health are longer, a table is new and one has more entries, everything lies elsewhere
    and in another order, and what is padding now is used.
    """
    head = shm.struct("ecat_shm_header").from_buffer_copy(data)
    made = bytearray(bytes(head) + bytes([FILLING]) * 72)
    made += bytes([FILLING]) * 264  # the new table

    def put(rows: bytes, more: int = 0) -> int:
        made.extend(b"\0" * (-len(made) % 64))
        made.extend(rows + bytes([FILLING]) * more)
        return len(made) - len(rows) - more

    domains = rows_of(data, "ecat_shm_domain", head.domains_offset, head.domain_count)
    for domain in domains:
        start, size = domain.page_offset, shm.size("ecat_shm_page")
        page = shm.struct("ecat_shm_page").from_buffer_copy(data, start)
        page.seq, page.wkc_state = 2, shm.WkcState.COMPLETE  # whatever the moment was
        image = data[start + size : start + size + domain.image_bytes]
        domain.page_offset = put(bytes(page) + image, 16)
    for name, table in reversed(shm.TABLES.items()):
        offset = getattr(head, f"{name}_offset")
        rows = rows_of(data, table.struct, offset, table.count(head))
        rows = domains if name == "domains" else rows
        for row in rows:
            use_padding(row)
        more = {"health": 104, "settings": shm.size("ecat_shm_setting")}.get(name, 0)
        setattr(head, f"{name}_offset", put(b"".join(bytes(row) for row in rows), more))
    head.layout, head.size, head.pad0 = LATER, len(made), 0xFFFFFFFF
    head.cycle_end_ns = 1 << 62  # "just now" for ever: no engine runs here
    made[: len(bytes(head))] = bytes(head)
    return bytes(made)


def rows_of(data: bytes, kind: str, offset: int, count: int) -> list[Any]:
    return list((shm.struct(kind) * count).from_buffer_copy(data, offset))


def use_padding(row: Any) -> None:
    for field in shm.fields_of(type(row).__name__):
        if field.name.startswith("pad") and field.count == 1:
            setattr(row, field.name, 0xFFFF)


@contextmanager
def served(name: str, data: bytes, out: bytes) -> Iterator[None]:
    """Both files under a name of their own, with the lock of a daemon held."""
    path = SHM / name
    path.write_bytes(data)
    path.with_name(f"{path.name}.out").write_bytes(out)
    fd = os.open(path, os.O_RDWR)
    try:
        assert take(fd, shm.LOCK_DAEMON)
        yield
    finally:
        os.close(fd)
        path.unlink()
        path.with_name(f"{path.name}.out").unlink()


@pytest.fixture
def later(troll: Daemon) -> Iterator[str]:
    """The name of a bus like that of `troll`, of a later minor version, at one moment."""
    folder = SHM
    out = bytearray((folder / f"{troll.bus}.out").read_bytes())
    offset = shm.struct("ecat_out_header").layout.offset
    out[offset : offset + 4] = struct.pack("<I", LATER)
    data = later_segment((folder / troll.bus).read_bytes())
    with served(f"{troll.bus}v", data, bytes(out)):
        yield f"{troll.bus}v"


def test_the_c_client_reads_a_later_minor_version(troll: Daemon, later: str) -> None:
    with Client(later) as client, troll.client() as present:
        client.sample()
        present.sample()
        assert client.fingerprint == present.fingerprint
        assert client.slaves() == present.slaves()
        mine, theirs = client.signals(), present.signals()
        assert [str(signal) for signal in mine] == [str(signal) for signal in theirs]
        seen = {signal["number"]: signal["raw"] for signal in contents(later)["signals"]}
        assert [signal.raw for signal in mine] == list(seen.values())
        assert {signal.validity for signal in mine} == {shm.Validity.VALID}
    with Handle(later) as handle:
        handle.sample()
        assert [handle.value(number) for number in range(len(mine))] == list(seen.values())


def test_ecatctl_tells_a_daemon_of_another_version(troll: Daemon) -> None:
    """After an upgrade the gateway of the new version may not understand the bus server."""
    data, out = ((SHM / f"{troll.bus}{end}").read_bytes() for end in ("", ".out"))
    other = data.replace(VERSION.encode().ljust(16, b"\0"), b"0.0.7".ljust(16, b"\0"), 1)
    name = f"{troll.bus}w"
    with served(name, other, out):
        done = run_module("ecatd.cli", "slaves", "--bus", name, "--timeout", "0.1")
    assert done.returncode == 3
    names(one_line_error(done.stderr, "ecatctl"), "0.0.7", VERSION, f"restart ecatd@{name}")


def test_the_readers_in_python_read_it_too(troll: Daemon, later: str) -> None:
    found, present = contents(later), contents(troll.bus)
    assert (found["layout"], found["problems"]) == (f"1.{LATER & 0xFFFF}", [])
    assert found["slaves"] == present["slaves"]
    assert [(s["name"], s["type"], s["unit"]) for s in found["signals"]] == [
        (s["name"], s["type"], s["unit"]) for s in present["signals"]
    ]
    assert found["settings"] == present["settings"]
    snapshot = read(later)
    assert 0 < snapshot.counters["cycles"] <= read(troll.bus).counters["cycles"]
    assert snapshot.grants == read(troll.bus).grants
    assert read_clocks(later)["slaves"] == read_clocks(troll.bus)["slaves"]
    assert len(read_outputs(later)["outputs"]) == len(read_outputs(troll.bus)["outputs"])
    for name in raw.NAMES:
        assert len(raw.read_raw(later, name)) == len(raw.read_raw(troll.bus, name))


# --- a whole daemon of a later minor version ------------------------------------------------------


def patched_definition(text: str) -> str:
    """`ecat_shm.def` of a later minor version."""
    for old, new in (
        ("#define ECAT_SHM_LAYOUT_MINOR 0u", "#define ECAT_SHM_LAYOUT_MINOR 1u"),
        (
            "ECAT_END(ecat_shm_header)",
            'ECAT_FIELD(uint64_t, later, 1, "new")\nECAT_FIELD(uint32_t, later_offset, 1, "new")\n'
            'ECAT_FIELD(uint32_t, later_count, 1, "new")\nECAT_END(ecat_shm_header)',
        ),
        (
            "ECAT_END(ecat_shm_health)",
            'ECAT_FIELD(uint64_t, later, 4, "new")\nECAT_END(ecat_shm_health)',
        ),
        (
            "ECAT_END_ENUM(ecat_ring)",
            'ECAT_VALUE(ECAT_RING_LATER, 3, "new")\nECAT_END_ENUM(ecat_ring)',
        ),
    ):
        assert old in text
        text = text.replace(old, new)
    return text


@pytest.fixture(scope="module")
def later_ecatd(tmp_path_factory: pytest.TempPathFactory, compiler: str) -> str:
    """PYTHONPATH of an ecatd that was built for a later minor version."""
    folder = tmp_path_factory.mktemp("later")
    shutil.copytree(ROOT / "client_c", folder / "client_c")
    definition = folder / "client_c" / "include" / "ecat" / "ecat_shm.def"
    definition.write_text(patched_definition(definition.read_text()))
    ignored = shutil.ignore_patterns("_native", "__pycache__")
    shutil.copytree(ROOT / "daemon" / "ecatd", folder / "ecatd", ignore=ignored)
    (folder / "ecatd" / "_native").mkdir()
    client = sorted((folder / "client_c" / "src").glob("*.c"))
    engine = sorted((ROOT / "daemon" / "cyclic").glob("*.c"))
    shared = ("histogram.c", "values.c")
    for name, sources in (
        ("ecat", client),
        ("ecat_cyclic", [*engine, *(folder / "client_c" / "src" / n for n in shared)]),
    ):
        subprocess.run(
            [
                *(compiler, "-std=c11", "-O1", "-D_GNU_SOURCE", "-fPIC", "-shared"),
                *(f"-I{folder / 'client_c' / part}" for part in ("include", "src")),
                *sources,
                *("-o", folder / "ecatd" / "_native" / f"lib{name}.so", "-lm", "-lpthread"),
            ],
            check=True,
        )
    return os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])


def test_a_client_works_with_a_later_daemon(
    start_daemon: Callable[..., Daemon], later_ecatd: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", later_ecatd)
    daemon = start_daemon("troll")
    document = daemon.ctl_json("shm")
    assert (document["layout"], document["problems"]) == ("1.1", [])
    assert contents(daemon.bus)["layout"] == "1.1"  # this process is of the earlier version
    assert contents(daemon.bus)["problems"] == []
    with daemon.client() as client:
        output, input_ = client.signal(EL2008, 0x7000, 1), client.signal(EL1018, 0x6000, 1)
        client.claim(EL2008, lease=30.0)
        for value in (1.0, 0.0, 1.0):

            def arrived(value: float = value) -> bool:
                output.raw = value
                client.commit()
                client.wait()
                client.sample()
                return input_.raw == value

            wait_for(arrived, daemon)
        (slot,) = read_outputs(daemon.bus)["owners"]
        assert (slot["pid"], slot["state"], slot["outputs"]) == (os.getpid(), "active", 8)
        assert client.sdo_upload(0, 0x1018, 1).result() == (0x9A).to_bytes(4, "little")


def test_r28_a_later_client_refuses_an_earlier_daemon(troll: Daemon, later_ecatd: str) -> None:
    env = {**troll.env, "PYTHONPATH": later_ecatd}
    for command in ("shm", "claims", "stats", "dc"):
        result = run_module("ecatd.cli", command, env=env)
        assert (result.returncode, result.stdout) == (7, "")
        said = one_line_error(result.stderr, "ecatctl")
        names(said, f"'{troll.bus}'", "1.0", "1.1", "update the daemon")
    program = "import sys; from ecatd.client import Client; Client(sys.argv[1])"
    result = subprocess.run(
        [sys.executable, "-c", program, troll.bus],
        env=env,
        text=True,
        capture_output=True,
        check=False,
    )
    last = result.stderr.splitlines()[-1]
    names(
        last, "ecatd.base.errors.StateError: ", f"'{troll.bus}'", "1.0", "1.1", "update the daemon"
    )


@pytest.mark.parametrize(
    ("macro", "tokens"),
    [
        ("ECAT_SHM_LAYOUT_MINOR=3u", "1.0 | 1.3 | update the daemon"),
        ("ECAT_SHM_LAYOUT_MAJOR=2u", "1.0 | 2.0 | update the daemon"),
        (
            "ECAT_SHM_LAYOUT_MAJOR=0u",
            "1.0 | 0.0 | update the client | generate",
        ),
        ("NOTHING", ""),
    ],
)
def test_what_clients_of_other_versions_say(
    troll: Daemon, tmp_path: Path, compiler: str, macro: str, tokens: str
) -> None:
    source = tmp_path / "client.c"
    source.write_text(
        "#include <ecat/ecat.h>\n#include <stdio.h>\n"
        "int main(int argc, char **argv) { ecat_t *bus = NULL; (void)argc;\n"
        "  int code = ecat_open(&bus, argv[1]);\n"
        "  if (code != 0) puts(ecat_error(bus)); ecat_close(bus); return code == ECAT_ELAYOUT; }\n"
    )
    client = ROOT / "client_c"
    subprocess.run(
        [
            *(compiler, "-std=c11", "-D_GNU_SOURCE", f"-D{macro}"),
            *(f"-I{client / part}" for part in ("include", "src")),
            *(source, *sorted((client / "src").glob("*.c")), "-o", tmp_path / "client", "-lm"),
        ],
        check=True,
    )
    result = subprocess.run(
        [tmp_path / "client", troll.bus], text=True, capture_output=True, check=False
    )
    assert result.returncode == (1 if tokens else 0)
    assert result.stdout.count("\n") == result.returncode
    if tokens:
        names(result.stdout, f"'{troll.bus}'", *tokens.split(" | "))


@pytest.mark.parametrize("client", [(1 << 16) | 3, 2 << 16, 0])
def test_readers_in_python_say_the_same(
    troll: Daemon, monkeypatch: pytest.MonkeyPatch, client: int
) -> None:
    monkeypatch.setattr(shm, "LAYOUT", client)
    cure = "update the client, and generate libraries again"
    if client:
        cure = "update the daemon, if that is not done yet, and restart its service"
    wanted = (
        f"the daemon of bus '{troll.bus}' speaks layout 1.0, "
        f"this client {client >> 16}.{client & 0xFFFF}: {cure}"
    )
    slaves = partial(raw.read_raw, table="slaves")
    for reader in (read, read_clocks, contents, read_outputs, slaves):
        with pytest.raises(StateError) as caught:
            reader(troll.bus)
        assert str(caught.value) == wanted
