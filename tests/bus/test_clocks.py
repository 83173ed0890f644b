"""Distributed clocks of a daemon: slaves that drift, on a real simulated segment.

What is judged are the clocks and SYNC signals of the simulated slaves, as the simulator itself
tells them, at one moment. How well the host keeps step depends on the machine: limits are wide.
"""

import base64
import contextlib
import os
import re
import statistics
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

from conftest import SHM, Daemon, names, naming, one_line_error
from ecatd.operations.encoding import unpack
from ecatd.operations.zenoh_keys import bus_key, session_config
from ecatd.shm import contract as shm
from ecatsim.control import Simulator
from ecatsim.slave.sii import Description, build

pytestmark = [pytest.mark.bus, pytest.mark.long]

CYCLE_TIME_US = 1000
"""The clocks of these tests are watched at 1000 cycles a second."""

HOP = 400  # ns from a slave of a line to the next
CYCLE = 1_000_000
# Slave 0 runs so fast that no noise can hide it.
DRIFTS = (300.0, 50.0, -50.0, 20.0, -20.0, 50.0)
IN_STEP = 1000
GENEROUS = "lock_us = 400.0\ntimeout_s = 30.0\n"


def line(folder: Path, *chips: str, drifts: tuple[float, ...] = DRIFTS) -> str:
    """A line of drifting slaves that have had power for different times; returns its rig file."""
    text = 'name = "clocks"\n'
    for position in range(len(drifts)):
        text += f"[[slave]]\nvendor = 0xFFFF\nproduct = {position}\nname = 'S{position}'\n"
        chip = chips[position] if position < len(chips) else ""
        text += f"[slave.chip]\n{chip}\n" if chip else ""
        for pdo, entry in ((0x1600, 0x7000), (0x1A00, 0x6000)):
            what = f"{{ index = {entry}, subindex = 1, name = 'Byte', type = 'uint8' }}"
            text += f"[[slave.pdo]]\nindex = {pdo}\nentry = [{what}]\n"
    for position, drift in enumerate(drifts):
        if position >= len(chips) or "dc = false" not in chips[position]:
            text += f'[[fault]]\nkind = "clock"\nslave = {position}\ndrift_ppm = {drift}\n'
            text += f"step_ns = {position * 1_234_567_890}\n" if position else ""
    rig = folder / "clocks.toml"
    rig.write_text(text)
    return str(rig)


@pytest.fixture
def start(
    start_daemon: Callable[..., Daemon], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., Daemon]:
    """Starts a daemon with a configuration on a rig; its simulator is the only one in sight."""
    monkeypatch.setenv("ECATSIM_RUNTIME_DIR", str(tmp_path / "sim"))

    def start(rig: str, config: str, **options: Any) -> Daemon:
        return start_daemon(rig, config=f"{config}\n[gateway]\nlisten = []\n", **options)

    return start


@pytest.fixture
def drifting(start: Callable[..., Daemon], tmp_path: Path) -> Daemon:
    """The line, with clocks in step."""
    return start(line(tmp_path), f"[dc]\nenabled = true\n{GENEROUS}")


@pytest.fixture
def simulator() -> Iterator[Callable[[], Simulator]]:
    """Connects to the simulator, once a daemon has started it."""
    opened: list[Simulator] = []

    def connect() -> Simulator:
        opened.append(Simulator())
        return opened[-1]

    yield connect
    for item in opened:
        item.close()


def table(bus: str, kind: str, name: str) -> list[Any]:
    """Rows of a table of the segment, as it is now."""
    data = (SHM / bus).read_bytes()
    header = shm.struct("ecat_shm_header").from_buffer_copy(data)
    count = header.slave_count if name.startswith("slave") else 1
    offset = getattr(header, f"{name}_offset")
    return list((shm.struct(kind) * count).from_buffer_copy(data, offset))


def health(daemon: Daemon) -> Any:
    (row,) = table(daemon.bus, "ecat_shm_health", "health")
    return row


@contextlib.contextmanager
def events(daemon: Daemon) -> Iterator[list[dict[str, Any]]]:
    """What the daemon publishes meanwhile."""
    endpoint = f"unixsock-stream/{daemon.env['ECATD_RUNTIME_DIR']}/{daemon.bus}/gateway/zenoh"
    heard: list[dict[str, Any]] = []
    with zenoh.open(session_config("client", {"connect/endpoints": [endpoint]})) as session:
        session.declare_subscriber(
            bus_key(daemon.bus, "ro", "event"),
            lambda sample: heard.append(unpack(bytes(sample.payload))),
        )
        yield heard


def wait_until(condition: Callable[[], bool], what: object = "") -> None:
    """Waits for something that must come, however slow the machine is."""
    for _ in range(600):
        if condition():
            return
        time.sleep(0.05)
    pytest.fail(f"does not come: {what() if callable(what) else what}")


def ahead(simulator: Simulator, reference: int = 0) -> list[int]:
    """How far the clocks of all slaves are ahead of the reference clock."""
    clocks = [clock.system_ns for clock in simulator.clocks()]
    return [clock - clocks[reference] for clock in clocks]


def signed(value: int) -> int:
    return (value + 2**31) % 2**32 - 2**31


def next_pulses(simulator: Simulator, position: int) -> tuple[int, int]:
    """The next pulses of SYNC0 and SYNC1."""
    first, second = struct.unpack("<QQ", simulator.registers(position, 0x0990, 16))
    return first, second


def zero(daemon: Daemon) -> int:
    """When cycle 0 was on the clock of the reference, as the most of some cycles say."""
    found = []
    path = SHM / daemon.bus
    for _ in range(50):
        data = path.read_bytes()
        header = shm.struct("ecat_shm_header").from_buffer_copy(data)
        values = shm.struct("ecat_shm_health").from_buffer_copy(data, header.health_offset)
        found.append((values.dc_time_ns + CYCLE // 4) // CYCLE - header.cycle)
        time.sleep(0.003)
    return max(set(found), key=found.count) * CYCLE


def test_drifting_clocks_hold_within_a_microsecond(
    drifting: Daemon, simulator: Callable[[], Simulator]
) -> None:
    there = simulator()
    for _ in range(20):
        assert max(map(abs, ahead(there))) < IN_STEP
        time.sleep(0.05)
    assert [clock.delay_ns for clock in there.clocks()] == pytest.approx(
        [position * HOP for position in range(len(DRIFTS))], abs=2
    )
    (told,) = (line for line in drifting.log.splitlines() if "clocks follow" in line)
    names(told, "5 clocks", "slave 0 (S0)")


def test_what_is_published(drifting: Daemon) -> None:
    rows = table(drifting.bus, "ecat_shm_slave", "slaves")
    assert [row.dc_bits for row in rows] == [64] * len(DRIFTS)
    assert [row.dc_delay_ns for row in rows] == pytest.approx(
        [position * HOP for position in range(len(DRIFTS))], abs=2
    )
    assert {row.sync0_ns for row in rows} == {0}
    assert health(drifting).dc_reference == 0
    wait_until(lambda: health(drifting).dc_state == shm.DcState.LOCKED)
    # The reference clock runs 300 ppm faster than CLOCK_MONOTONIC, by which the simulator goes.
    wait_until(lambda: 150e3 < health(drifting).dc_drift_ppb < 450e3, health(drifting).dc_drift_ppb)
    wait_until(lambda: health(drifting).dc_offset.count > 0)
    first = health(drifting).dc_time_ns
    wait_until(lambda: health(drifting).dc_time_ns > first)
    # Around 2000-01-01, in UTC.
    assert first == pytest.approx(time.time_ns() - 946_684_800 * 10**9, abs=60 * 10**9)
    document = drifting.slave_rows("slaves")
    assert [row["dc_bits"] for row in document] == [64] * len(DRIFTS)
    assert [row["dc_delay_ns"] for row in document] == [row.dc_delay_ns for row in rows]


def test_branches(start: Callable[..., Daemon], simulator: Callable[[], Simulator]) -> None:
    """Delays that were wrong would be errors of the clocks; terminals have none, couplers do."""
    start("branches", f"[dc]\nenabled = true\n{GENEROUS}")
    there = simulator()
    clocks, differences = there.clocks(), ahead(there)
    positions = [position for position, clock in enumerate(clocks) if clock.offset_ns]
    assert len(positions) > 3
    assert max(abs(differences[position]) for position in positions) <= 5
    assert len({clocks[position].delay_ns for position in positions}) == len(positions)


def test_a_ring(
    start: Callable[..., Daemon], simulator: Callable[[], Simulator], tmp_path: Path
) -> None:
    """Frames leave by the second interface, and yet the delays are measured; the ring is whole."""
    rig = Path(line(tmp_path))
    rig.write_text(f"ring = true\n{rig.read_text()}")
    config = f'second_interface = "ecat-master2"\n[dc]\n{GENEROUS}[[dc.slave]]\nslave = 5\n'
    daemon = start(str(rig), config)
    there = simulator()
    assert [clock.delay_ns for clock in there.clocks()] == pytest.approx(
        [position * HOP for position in range(len(DRIFTS))], abs=2
    )
    for _ in range(10):
        assert max(map(abs, ahead(there))) < IN_STEP
        time.sleep(0.05)
    wait_until(lambda: health(daemon).ring == shm.Ring.CLOSED)
    assert there.registers(len(DRIFTS) - 1, 0x0101, 1) == b"\0"


def test_a_ring_that_is_broken_at_the_start(
    start: Callable[..., Daemon], simulator: Callable[[], Simulator], tmp_path: Path
) -> None:
    """The slaves behind the break get an estimate, and are in step when the cable is mended."""
    rig = Path(line(tmp_path))
    broken = '[[fault]]\nkind = "break-link"\nslave = 4\n'
    rig.write_text(f"ring = true\n{rig.read_text()}{broken}")
    config = f'second_interface = "ecat-master2"\n[dc]\n{GENEROUS}[[dc.slave]]\nslave = 5\n'
    start(str(rig), config)
    there = simulator()
    assert [clock.delay_ns for clock in there.clocks()] == pytest.approx(
        [position * HOP for position in range(len(DRIFTS))], abs=2
    )
    assert max(map(abs, ahead(there)[:4])) < IN_STEP
    # As good as the host's own clock, which gets 300 µs away in a second if nobody tells it.
    assert max(map(abs, ahead(there))) < 500_000
    there.faults.heal_link(4)
    wait_until(lambda: max(map(abs, ahead(there))) < IN_STEP, lambda: ahead(there))


def test_sync_signals(
    start: Callable[..., Daemon], simulator: Callable[[], Simulator], tmp_path: Path
) -> None:
    daemon = start(
        line(tmp_path),
        f"""
        [[domain]]
        [[domain]]
        name = "slow"
        divider = 4
        phase = 3
        slaves = [2]
        [dc]
        {GENEROUS}
        [[dc.slave]]
        slave = 0
        [[dc.slave]]
        slave = 2
        shift_us = 100
        [[dc.slave]]
        slave = 3
        sync0_us = 500
        shift_us = -50
        sync1_us = 125
        [[dc.slave]]
        slave = 4
        sync1_us = 3200
        [[dc.slave]]
        slave = 5
        sync0_us = 4_000_000
        """,
    )
    there = simulator()
    activations = [there.registers(position, 0x0981, 1)[0] for position in range(6)]
    assert activations == [0x03, 0x00, 0x03, 0x07, 0x07, 0x03]
    start_of_cycle_0 = zero(daemon)
    for position, period, shift in (
        (0, CYCLE, CYCLE // 2),
        (2, 4 * CYCLE, 3 * CYCLE + 100_000),  # with the cycles in which its domain is exchanged
        (3, CYCLE // 2, -50_000),
        (4, CYCLE, CYCLE // 2),
        (5, 4000 * CYCLE, CYCLE // 2),
    ):
        pulse, _ = next_pulses(there, position)
        assert (pulse - start_of_cycle_0 - shift) % period == 0, position
    before, after = next_pulses(there, 3)
    assert (after - before) % (CYCLE // 2) == 125_000
    _, after = next_pulses(there, 4)
    assert (after - start_of_cycle_0 - CYCLE // 2) % (4 * CYCLE) == 3_200_000
    rows = table(daemon.bus, "ecat_shm_slave", "slaves")
    assert [(row.sync0_ns, row.sync1_ns, row.sync_shift_ns) for row in rows] == [
        (1_000_000, 0, 500_000),
        (0, 0, 0),
        (4_000_000, 0, 100_000),
        (500_000, 125_000, -50_000),
        (1_000_000, 3_200_000, 500_000),
        (4_000_000_000, 0, 500_000),
    ]
    # SYNC0 and the frames stay where they are to each other, though the clocks drift.
    wait_until(lambda: health(daemon).dc_state == shm.DcState.LOCKED)
    assert zero(daemon) == start_of_cycle_0


def test_a_drive_that_goes_by_sync0(
    start: Callable[..., Daemon], simulator: Callable[[], Simulator], tmp_path: Path
) -> None:
    """Its EEPROM gives a latch unit to the device in the only mode with SYNC0."""
    rig = tmp_path / "drive.toml"
    rig.write_text(
        'name = "drive"\n[[slave]]\ndevice = "CiA402"\n'
        "[[slave]]\nvendor = 0xFFFF\nproduct = 1\nname = 'Latch'\n[slave.mailbox]\n"
        "[[slave.dc_mode]]\nname = 'free'\nassign_activate = 0\n"
        "[[slave.dc_mode]]\nname = 'DC'\nassign_activate = 0x0320\n"
    )
    daemon = start(str(rig), f"[dc]\n{GENEROUS}[[dc.slave]]\nslave = 0\n[[dc.slave]]\nslave = 1\n")
    there = simulator()
    assert there.registers(0, 0x0980, 2) == b"\x00\x03"
    assert there.registers(1, 0x0980, 2) == b"\x20\x03"
    assert {row["text"] for row in daemon.slave_rows("state")} == {"OP"}
    assert daemon.ctl("sdo-read", "0", "1C32:0A").stdout.split()[1] == str(CYCLE)


def test_signals_that_come_too_fast_for_the_device(
    start: Callable[..., Daemon], tmp_path: Path
) -> None:
    rig = tmp_path / "slow.toml"
    rig.write_text(
        "name = 'slow'\n[[slave]]\nvendor = 0xFFFF\nproduct = 1\nname = 'Slow'\n"
        "minimum_cycle_ns = 2000000\n[slave.mailbox]\n[[slave.dc_mode]]\nname = 'DC'\n"
        "[[slave.pdo]]\nindex = 0x1A00\n"
        "entry = [{ index = 0x6000, subindex = 1, name = 'Byte', type = 'uint8' }]\n"
    )
    daemon = start(str(rig), f"[dc]\n{GENEROUS}[[dc.slave]]\nslave = 0\n", ready=False)
    status, log = daemon.wait_end()
    assert status == 7
    refusal = "slave 0 (Slow) does not reach SAFEOP: PREOP+ERROR (AL status 0x0036: "
    assert refusal in one_line_error(log, "ecatd")


def test_signals_that_come_too_fast_for_their_pulses(
    start: Callable[..., Daemon], tmp_path: Path
) -> None:
    """An EEPROM wants pulses of 655.35 µs."""
    image = build(Description(0xFFFF, 1, 1, pdi_control=0x0C00, sync_pulse=0xFFFF))
    text = base64.b64encode(image).decode()
    rig = tmp_path / "pulses.toml"
    rig.write_text(
        f"name = 'pulses'\n[[slave]]\nsii = 'base64:{text}'\n[[slave]]\ndevice = 'Loopback32'\n"
    )
    config = f"[dc]\n{GENEROUS}[[dc.slave]]\nslave = 0\nsync0_us = "
    daemon = start(str(rig), f"{config}500\n", ready=False)
    status, log = daemon.wait_end()
    assert status == 2
    refusal = "makes pulses of 655.35 µs, so SYNC0 cannot come every 500 µs"
    assert refusal in one_line_error(log, "ecatd")
    start(str(rig), f"{config}1000\n")


def test_another_reference_clock(
    start: Callable[..., Daemon], simulator: Callable[[], Simulator], tmp_path: Path
) -> None:
    daemon = start(
        line(tmp_path, drifts=(50.0, -50.0, 300.0, 20.0, -20.0)),
        f"[dc]\nreference = 2\nphase_us = 300\n{GENEROUS}[[dc.slave]]\nslave = 4\n",
    )
    there = simulator()
    assert health(daemon).dc_reference == 2
    for _ in range(10):
        assert max(map(abs, ahead(there, 2)[2:])) < IN_STEP
        time.sleep(0.05)
    assert [clock.delay_ns for clock in there.clocks()] == pytest.approx(
        [0, 0, 0, HOP, 2 * HOP], abs=2
    )
    # Signals go by the clock; frames leave when its cycle is 300 µs old, or somewhat later.
    pulse, _ = next_pulses(there, 4)
    assert pulse % CYCLE == CYCLE // 2
    phases = []
    for _ in range(100):
        phases.append(health(daemon).dc_time_ns % CYCLE)
        time.sleep(0.005)
    assert 290_000 < statistics.median(phases) < 800_000


@pytest.mark.parametrize("narrow", [0, 2])
def test_clocks_of_32_bits(
    start: Callable[..., Daemon], simulator: Callable[[], Simulator], tmp_path: Path, narrow: int
) -> None:
    """Slave 1 has no clock; the reference clock, or one that follows, goes round every 4.3 s."""
    chips = ["", "dc = false", "", ""]
    chips[narrow] = "dc_bits = 32"
    signals = "".join(f"[[dc.slave]]\nslave = {position}\n" for position in (0, 2, 3))
    daemon = start(
        line(tmp_path, *chips, drifts=(300.0, 0.0, -50.0, 50.0)), f"[dc]\n{GENEROUS}{signals}"
    )
    there = simulator()
    with_clock = [0, 2, 3]
    for _ in range(5):
        differences = ahead(there)
        assert max(abs(signed(differences[position])) for position in with_clock) < IN_STEP
        time.sleep(0.05)
    rows = table(daemon.bus, "ecat_shm_slave", "slaves")
    assert [row.dc_bits for row in rows] == [
        32 if i == narrow else (64, 0, 64, 64)[i] for i in range(4)
    ]
    origin = zero(daemon)
    for position in with_clock:
        with daemon.client() as client:
            client.wait()
            client.sample()
            latest = origin + client.domain().cycle * CYCLE
        pulse, _ = next_pulses(there, position)
        # Their common part are the lower 32 bits, which tell times of the last two seconds apart.
        assert (latest + signed(pulse - latest)) % CYCLE == CYCLE // 2, position


def test_ecatctl_dc(start: Callable[..., Daemon], tmp_path: Path) -> None:
    rig = line(tmp_path, "", "", "dc = false", "dc_bits = 32", drifts=(300.0, 50.0, 0.0, -50.0))
    daemon = start(
        rig,
        f"[dc]\nreference = 1\n{GENEROUS}[[dc.slave]]\nslave = 3\nsync1_us = 10.5\n",
    )
    wait_until(lambda: daemon.ctl_json("dc")["phase"]["count"] > 0)
    here = daemon.ctl_json("dc")
    endpoint = f"unixsock-stream/{daemon.env['ECATD_RUNTIME_DIR']}/{daemon.bus}/gateway/zenoh"
    there = daemon.ctl_json("dc", "--connect", endpoint)
    for document in (here, there):
        assert (document["bus"], document["reference"]) == (daemon.bus, 1)
        assert document["phase"]["p50"] <= document["phase"]["p99"] <= document["phase"]["max"]
        differences = [row["dc_difference_ns"] for row in document["slaves"]]
        assert differences[:3] == [None, None, None]
        assert abs(differences[3]) < IN_STEP
        assert [row["dc_bits"] for row in document["slaves"]] == [64, 64, 0, 32]
        assert document["slaves"][3]["dc_delay_ns"] == pytest.approx(2 * HOP, abs=2)
    assert {k: type(v) for k, v in here.items()} == {k: type(v) for k, v in there.items()}
    wait_until(lambda: daemon.ctl_json("dc")["state"] == "locked")
    summary, text = daemon.ctl("dc").stdout.split("\n\n")
    names(summary.splitlines()[0], "slave 1")
    assert [line.split()[0] for line in summary.splitlines()[1:]] == ["time", "drift", "phase"]
    rows = text.splitlines()
    assert rows[0].split()[:5] == ["POS", "NAME", "CLOCK", "DELAY", "DIFFERENCE"]
    assert rows[1].split()[4:9] == ["0", "ns", "does", "not", "follow"]
    assert rows[2].split() == ["1", "S1", "64", "bit", "0", "ns", "reference", "-", "-", "-"]
    assert rows[3].split() == ["2", "S2", *"------"]
    assert rows[4].split()[-6:] == ["1000", "µs", "500", "µs", "10.5", "µs"]


def test_ecatctl_dc_without_dc(troll: Daemon) -> None:
    assert (troll.ctl_json("dc")["state"], troll.ctl_json("dc")["reference"]) == ("off", -1)
    first, second, *rows = troll.ctl("dc").stdout.splitlines()
    names(first, "distributed clocks", "off")
    assert max(map(len, rows)) <= 80
    assert "  0  Gold EtherCAT GCON Dr…  64 bit " in rows[2]
    assert int(second.removeprefix("slaves with a clock: ")) > 0


def test_clocks_that_are_switched_off_are_told(start: Callable[..., Daemon]) -> None:
    daemon = start("troll", "[dc]\nenabled = false\nreference = 4\n[[dc.slave]]\nslave = 0\n")
    told = [line for line in daemon.log.splitlines() if "warning: dc.enabled" in line]
    assert len(told) == 2, daemon.log
    names([line for line in told if "[[dc.slave]]" in line], "[[dc.slave]]", "SYNC")
    names([line for line in told if "reference" in line], "dc.reference = 4")
    assert daemon.ctl_json("dc")["state"] == "off"


def test_a_lock_that_is_lost_and_found_again(
    start: Callable[..., Daemon], simulator: Callable[[], Simulator], tmp_path: Path
) -> None:
    daemon = start(
        line(tmp_path, drifts=(0.0, 50.0, -50.0)),
        "[dc]\nenabled = true\nlock_us = 100.0\ntimeout_s = 30.0\n",
    )
    there = simulator()
    with events(daemon) as heard:
        there.faults.clock(0, step_ns=450_000)
        for state in ("locking", "locked"):
            wait_until(
                lambda state=state: any(
                    event["event"] == "clock" and event["state"] == state for event in heard
                ),
                lambda: heard,
            )

    def told(line: str, *tokens: str) -> bool:
        return re.search(naming("clock", "slave 0 (S0)", *tokens), line) is not None

    def lost_and_found() -> bool:
        lines = daemon.log.splitlines()
        lost = [n for n, line in enumerate(lines) if told(line, "warning", "lost")]
        return bool(lost) and any(told(line, "again") for line in lines[lost[-1] :])

    wait_until(lost_and_found, lambda: daemon.log)
    wait_until(lambda: max(map(abs, ahead(there))) < IN_STEP)


def test_a_clock_out_of_step(drifting: Daemon, simulator: Callable[[], Simulator]) -> None:
    there = simulator()
    with events(drifting) as heard:
        there.faults.clock(3, step_ns=3_000_000)  # for which it needs four seconds
        wait_until(lambda: any(event["event"] == "clock_difference" for event in heard))
    (event,) = (event for event in heard if event["event"] == "clock_difference")
    assert event["slave"] == 3
    assert IN_STEP < event["difference_ns"] <= 3_000_000
    out = re.compile(r"warning: .*slave 3 \(S3\) .*out of step.*\+\d")
    wait_until(lambda: out.search(drifting.log) is not None)
    row = table(drifting.bus, "ecat_shm_slave_status", "slave_status")[3]
    assert IN_STEP < row.dc_difference_ns <= 3_000_000
    wait_until(lambda: re.search(r"slave 3 \(S3\) .*in step", drifting.log) is not None)
    wait_until(lambda: max(map(abs, ahead(there))) < IN_STEP)
    there.faults.clock(4, drift_ppm=-150.0)
    wait_until(lambda: abs(ahead(there)[4]) < IN_STEP)


@pytest.mark.parametrize(
    ("config", "reason"),
    [
        ("reference = 1", "dc.reference: | slave 1 (S1) | no distributed clock | 0, 2, 3"),
        ("reference = 9\nenabled = true", "dc.reference: | slave 9"),
        ("[[dc.slave]]\nslave = 1", "dc.slave[0].slave: | slave 1 (S1) | no distributed clock"),
        ("[[dc.slave]]\nslave = 4", "dc.slave[0].slave: | slave 4"),
        ("reference = 2\n[[dc.slave]]\nslave = 0", "dc.slave[0].slave: | slave 0 (S0) | "
         "reference | slave 2 (S2)"),
        ("[[dc.slave]]\nslave = 3\nsync0_us = 1000.0\nsync1_us = 2_000_000.0",
         "dc.slave[0].sync0_us: | slave 3 (S3) | 32 bits"),
    ],
)  # fmt: skip
def test_refused(start: Callable[..., Daemon], tmp_path: Path, config: str, reason: str) -> None:
    enabled = "" if "dc.slave" in config or "enabled" in config else "enabled = true\n"
    rig = line(tmp_path, "", "dc = false", "", "dc_bits = 32", drifts=(0.0, 0.0, 0.0, 0.0))
    daemon = start(rig, f"[dc]\n{enabled}{config}\n", ready=False)
    status, log = daemon.wait_end()
    # A slave that is not there may come later.
    assert status == (7 if "there is no slave" in log else 2)
    names(one_line_error(log, "ecatd"), *reason.split(" | "))


def test_a_bus_without_clocks(start: Callable[..., Daemon], tmp_path: Path) -> None:
    rig = line(tmp_path, "dc = false", "dc = false", drifts=(0.0, 0.0))
    daemon = start(rig, "[dc]\nenabled = true\n", ready=False)
    status, log = daemon.wait_end()
    assert status == 2
    names(one_line_error(log, "ecatd"), "no slave", f"'{daemon.bus}'", "clock")
    assert {row["dc_bits"] for row in start(rig, "").slave_rows("slaves")} == {0}


def test_a_lock_that_does_not_come(start: Callable[..., Daemon], tmp_path: Path) -> None:
    """A hundred cycles of 10 ms do not go into a tenth of a second."""
    rig = line(tmp_path, drifts=(0.0, 50.0))
    daemon = start(
        rig, "cycle_time_us = 10000\n[dc]\nenabled = true\ntimeout_s = 0.1\n", ready=False
    )
    status, log = daemon.wait_end()
    assert status == 7
    message = one_line_error(log, "ecatd")
    names(message, "distributed clocks", "0.1 s", "not locked")


def test_stopping_ends_the_signals(tmp_path: Path) -> None:
    """Seen in the simulator, when the daemon has left the interface."""
    code = (
        "import pathlib, socket, subprocess, sys\n"
        "from ecatsim.control import Simulator\n"
        "ready = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM); ready.bind('notify')\n"
        "daemon = subprocess.Popen([sys.executable, '-m', 'ecatd.service', '--interface',"
        " 'ecat-master', '--bus', sys.argv[1], '--config', 'dc.toml'])\n"
        "while b'READY=1' not in ready.recv(4096): pass\n"
        "look = lambda: [Simulator().registers(0, at, 1)[0] for at in (0x0130, 0x0981)]\n"
        "before = look()\n"
        "daemon.terminate(); assert daemon.wait() == 0\n"
        "print(before, look())\n"
    )
    (tmp_path / "dc.toml").write_text(
        f"[gateway]\nlisten = []\n[dc]\n{GENEROUS}[[dc.slave]]\nslave = 0\n"
    )
    env = {
        **os.environ,
        "ECATD_RUNTIME_DIR": str(tmp_path / "run"),
        "ECATSIM_RUNTIME_DIR": str(tmp_path / "sim"),
        "NOTIFY_SOCKET": str(tmp_path / "notify"),
    }
    rig = line(tmp_path, drifts=(0.0, 50.0))
    master = [sys.executable, "-c", code, f"t{os.getpid()}dc"]
    result = subprocess.run(
        [sys.executable, "-m", "ecatsim", "run", rig, "--", *master],
        env=env,
        cwd=tmp_path,
        text=True,
        capture_output=True,
        check=False,
    )
    assert result.stdout == "[8, 3] [1, 0]\n", result.stdout + result.stderr
