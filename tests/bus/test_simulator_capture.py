"""`ecatsim capture`: what it writes simulates what it has seen.

Masters run as commands inside `ecatsim run`; functions named `master_…` are such commands.
"""

import base64
import fcntl
import json
import signal
import socket
import struct
import subprocess
import sys
from pathlib import Path

import pytest
from masters import new_master

from conftest import names, one_line_error
from ecatd.base.errors import StateError
from ecatsim.capture import capture
from ecatsim.devices.beckhoff import EL3008

pytestmark = [pytest.mark.bus, pytest.mark.long]

INTERFACE = "ecat-master"
INIT, PREOP = 1, 2
TX_PDO = 0x80
HERE = Path(__file__)

ODD = """\
[[slave]]
vendor = 0xFFFF
product = 7
name = "Odd"
variable_assignment = true
variable_mapping = true
[slave.mailbox]
coe_details = 0x2F
[[slave.pdo]]
index = 0x1600
entry = [{ index = 0x7000, subindex = 1, name = "A \\"quoted\\" \\\\ name", type = "int16" }]
[[slave.pdo]]
index = 0x1601
assigned = false
entry = [{ index = 0x7000, subindex = 2, name = "Grüße", type = "real32" }]
[[slave.pdo]]
index = 0x1A00
entry = [{ index = 0x6000, subindex = 1, type = "bit4" }, { gap = 12 }]
[[slave.object]]
index = 0x2000
name = "Write-only"
type = "uint16"
access = "wo"
[[slave.object]]
index = 0x2001
name = "Refused"
type = "uint32"
abort = 0x08000022
[[slave.object]]
index = 0x2002
name = "With holes"
entry = [
  { subindex = 2, name = "Text", type = "string", value = "a\\u0000b\\n", bits = 64 },
  { subindex = 5, name = "Bytes", type = "octet_string", value = "00 ff 10" },
  { subindex = 6, name = "Unicode", type = "unicode_string", value = "Ω" },
  { subindex = 7, name = "Unknown", type = 0x0260, data = "01 02 03" },
  { subindex = 8, name = "Real", type = "real64", value = 0.1, access = 0x0047 },
  { subindex = 9, name = "Not a number", type = "real32", data = "00 00 c0 7f" },
  { subindex = 10, name = "Longer than its type", type = "uint16", data = "01 02 03 04" },
  { subindex = 11, name = "Negative", type = "integer24", value = -5 },
  { subindex = 12, name = "Truth", type = "bool", value = true, access = "rw-preop" },
]
[[slave]]
sii = "base64:%s"
[[slave.pdo]]
index = 0x1A02
entry = [{ index = 0x6010, subindex = 0x11, type = "int16" }]
[[slave]]
device = "EK1100"
alias = 9
[[slave]]
device = "EL2008"
[[slave]]
device = "Loopback32"
at = { slave = 2, port = 2 }
[[slave]]
device = "EL1018"
"""


def eeprom(slave):
    """Its EEPROM up to the mark behind its categories; to read what is empty takes much longer."""
    image, end = b"", 2 * 0x40
    while True:
        while len(image) < end + 4:
            image += slave.eeprom_read(len(image) // 2)[:4]
        category, words = struct.unpack_from("<HH", image, end)
        end += 4 + 2 * words
        if category == 0xFFFF:
            return image


def master_look(count):
    """Everything that a master can read of a segment, in each of `count` looks."""
    import pysoem

    def sdo(slave, index, subindex):
        master._collect_mailbox_errors()  # of subindices that the slave does not describe
        try:
            return slave.sdo_read(index, subindex).hex()
        except pysoem.SdoError as error:
            return f"abort {error.abort_code & 0xFFFFFFFF:08X}"

    def describe(slave):
        found = {}
        for item in slave.od:
            entries = [
                (e.name.hex(), e.data_type, e.bit_length, e.obj_access) for e in item.entries
            ]
            entries = entries or [
                (item.name.hex(), item.data_type, item.bit_length, item.obj_access)
            ]
            values = [sdo(slave, item.index, i) for i in range(len(entries) + 1)]
            head = (item.name.hex(), item.data_type, item.object_code)
            found[f"{item.index:04X}"] = (head, entries, values)
        found["missing"] = sdo(slave, 0x5FFF, 0)
        return found

    looks = []
    for _ in range(count):
        master = new_master()
        master.open(INTERFACE)
        slaves = []
        if master.config_init() > 0:
            assert master.state_check(PREOP, 2_000_000) == PREOP
            for slave in master.slaves:
                image = eeprom(slave)
                registers = slave._fprd(0, 10).hex(), slave._fprd(0x12, 2).hex()
                coe = slave._fprd(0x800, 8) and image[2 * 0x1C] & 4
                objects = describe(slave) if coe else {}
                identity = (slave.name, slave.man, slave.id, slave.rev)
                slaves.append([identity, image.hex(), registers, objects])
            master.config_map()
            for slave, facts in zip(master.slaves, slaves, strict=True):
                facts.append((len(slave.output), len(slave.input)))
            master.state = INIT
            master.write_state()
            assert master.state_check(INIT, 2_000_000) == INIT
        looks.append(slaves)
        master.close()
    return looks


def ecatsim(*arguments):
    """Runs `ecatsim` where it can reach the segment."""
    return subprocess.run(
        [sys.executable, "-m", "ecatsim", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
    )


def master_capture(*arguments):
    result = ecatsim("capture", "--interface", INTERFACE, *arguments)
    return result.returncode, result.stdout, result.stderr


def master_look_and_capture(file):
    (before,) = master_look(1)
    status, _, said = master_capture("-o", file)
    assert status == 0, said
    (after,) = master_look(1)
    return before, after


def seen(rig, master, *arguments):
    """Runs a master beside a rig and returns what it found."""
    folders = [str(folder) for folder in HERE.parents[:2]]
    code = (
        f"import sys, json; sys.path[:0] = {folders!r}; import {HERE.stem} as t; "
        f"print('found', json.dumps(t.{master.__name__}(*{arguments!r})))"
    )
    result = ecatsim("run", rig, "--", sys.executable, "-c", code)
    assert result.returncode == 0, result.stderr + result.stdout
    return json.loads(result.stdout.splitlines()[-1].removeprefix("found "))


def without_live_values(slaves):
    """Values of inputs change by themselves; only their length is kept."""
    for slave in slaves:
        for item in slave[3].values():
            for number, entry in enumerate(item[1] if isinstance(item, list) else ()):
                if entry[3] & TX_PDO and not item[2][number].startswith("abort"):
                    item[2][number] = len(item[2][number])
    return slaves


@pytest.fixture
def odd(tmp_path):
    """A rig with whatever is rare."""
    file = tmp_path / "odd.toml"
    file.write_text(ODD % base64.b64encode(EL3008().sii_image()).decode())
    return file


def captured_twice(folder, rig):
    """Looks at a segment, and at what simulates it; and the files captured from both."""
    files = [folder / name / "captured.toml" for name in ("first", "second")]
    looks = []
    for source, file in zip((rig, files[0]), files, strict=True):
        file.parent.mkdir()
        looks.append(seen(source, master_look_and_capture, str(file)))
        assert list(file.parent.iterdir()) == [file]
    return looks, files


def test_a_captured_segment_is_the_same_to_a_master(tmp_path):
    ((before, after), (again, _)), files = captured_twice(tmp_path, "troll")
    assert len(before) == 8
    assert without_live_values(after) == without_live_values(before)
    assert without_live_values(again) == before
    assert files[0].read_bytes() == files[1].read_bytes()


def test_what_is_rare_is_captured_as_well(tmp_path, odd):
    ((before, _), (again, _)), files = captured_twice(tmp_path, odd)
    assert again == before
    values = before[0][3]["2002"][2]
    assert values[1] == values[3] == "abort 06090011"
    assert before[0][3]["2001"][2][0] == "abort 08000022"
    assert before[1][4] == [0, 2]  # as the assignment says, not as the SII does
    text = files[0].read_text()
    assert "# 0x2001:00 cannot be read: 0x08000022, Data cannot be transferred" in text
    assert text.count("[[slave.pdo]]") == 1  # of the second slave
    assert "at = { slave = 2, port = 2 }" in text
    assert files[1].read_text() == text


def test_what_it_says(tmp_path):
    file = tmp_path / "captured.toml"
    status, said, progress = seen("line:2", master_capture, "-o", str(file))
    assert (status, said) == (0, f"{file}: 2 slaves; `ecatsim run {file}` simulates them\n")
    assert progress.splitlines()[0] == "slave 1 of 2: Loopback32: EEPROM"


def test_without_objects(tmp_path):
    file = tmp_path / "captured.toml"
    assert seen("troll", master_capture, "--no-objects", "-o", str(file))[0] == 0
    assert "object" not in file.read_text()
    (slaves,) = seen(file, master_look, 1)
    assert [slave[4] for slave in slaves[:5]] == [[16, 16], [0, 0], [0, 1], [1, 0], [0, 32]]
    assert slaves[0][3]["1018"][2][1] == "9a000000"


def test_an_existing_file_is_kept_unless_forced(tmp_path):
    file = tmp_path / "captured.toml"
    file.write_text("mine")
    status, _, said = seen("line:1", master_capture, "-o", str(file))
    assert status == 2
    assert said.count("\n") == 1
    names(one_line_error(said, "ecatsim"), f"'{file}'", "exists", "--force")
    assert file.read_text() == "mine"
    assert seen("line:1", master_capture, "--force", "-o", str(file))[0] == 0
    assert "[[slave]]" in file.read_text()


@pytest.mark.parametrize(
    ("rig", "arguments", "status", "message"),
    [
        ("empty", ["-o", "x.toml"], 3, "no EtherCAT slave | 'ecat-master'"),
        ("line:1", ["-o", "x.txt"], 2, "'x.txt' | .toml"),
        ("line:1", ["-o", "/nowhere/x.toml"], 2, "'/nowhere/x.toml' | no folder"),
        ("line:1", [], 2, "required | -o"),
    ],
)
def test_mistakes(rig, arguments, status, message):
    found, _, said = seen(rig, master_capture, *arguments)
    assert found == status
    names(one_line_error(said, "ecatsim"), *message.split(" | "))
    assert not Path("x.toml").exists()


def test_an_interface_that_does_not_exist():
    result = ecatsim("capture", "--interface", "nope0", "-o", "x.toml")
    assert result.returncode == 3
    names(one_line_error(result.stderr, "ecatsim"), "interface", "'nope0'")


def states():
    """AL status of all slaves, or-ed, and the flags of the interface."""
    datagram = struct.pack("<BBHHHH", 7, 0x55, 0, 0x0130, 2, 0) + bytes(4)
    frame = b"\xff" * 12 + b"\x88\xa4" + struct.pack("<H", 0x1000 | len(datagram)) + datagram
    with socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(0x88A4)) as raw:
        raw.bind((INTERFACE, 0x88A4))
        raw.settimeout(60)
        raw.send(frame.ljust(60, b"\0"))
        while True:
            answer = raw.recv(2048)
            if answer[17] == 0x55 and answer[28:30] != b"\0\0":
                request = struct.pack("16sh14x", INTERFACE.encode(), 0)
                flags = fcntl.ioctl(raw, 0x8913, request)  # SIOCGIFFLAGS
                return answer[26], flags.hex()


def master_capture_in(state):
    """What happens in a state; and states and interface flags before and after."""

    master = new_master()
    master.open(INTERFACE)
    master.config_init()
    if state > PREOP:
        master.config_map()
    master.state = state
    master.write_state()
    assert master.state_check(state, 2_000_000) == state
    master.close()
    before = states()
    said = ""
    try:
        slaves = len(capture(INTERFACE, lambda line: None, objects=False))
    except StateError as error:
        slaves, said = 0, str(error)
    return before, states(), slaves, said


def master_interrupt(file):
    """Interrupts a capture while it reads objects; its status, what it says last, and the state."""
    command = [sys.executable, "-m", "ecatsim", "capture", "--interface", INTERFACE, "-o", file]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    for line in process.stderr:
        if "object 25 of" in line:
            process.send_signal(signal.SIGINT)
            break
    *_, last = process.stderr.read().splitlines()
    return process.wait(), last, states()[0]


def test_an_interrupted_capture_leaves_nothing(tmp_path):
    status, said, state = seen("troll", master_interrupt, str(tmp_path / "captured.toml"))
    assert (status, state) == (130, 1)
    names(one_line_error(said, "ecatsim"), "interrupted")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("state", [1, PREOP])
def test_the_segment_is_left_as_it_was_found(state):
    before, after, slaves, said = seen("troll", master_capture_in, state)
    assert before == after
    assert (before[0], slaves, said) == (state, 8, "")


def test_a_segment_in_use_is_left_alone():
    before, after, slaves, said = seen("line:3", master_capture_in, 4)
    assert before == after
    assert (before[0], slaves) == (4, 0)
    names(said, "'ecat-master'", "SAFEOP", "OP", "master")
