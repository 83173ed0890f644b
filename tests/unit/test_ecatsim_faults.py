"""Faults on demand: when they strike, and what each does on the wire, frame by frame."""

import os
import struct
import threading

import pytest
from test_ecatsim_frames import APRD, APWR, BRD, LRW, datagram, frame

from conftest import names, naming
from ecatd.base.errors import StateError, UsageError
from ecatsim import Chip, DataType, Device, Entry, Mailbox, Pdo, Rig, Simulation
from ecatsim.faults import parse
from ecatsim.faults.schedule import MAX_FAULTS


class Word(Device):
    """A word out, a word in, with a mailbox."""

    vendor, product, revision, order = 0x10, 0x20, 0x30, "Word"
    mailbox = Mailbox()
    rx_pdos = (Pdo(0x1600, "Out", 2, [Entry(0x7000, 1, "Out", DataType.UNSIGNED16, 16)]),)
    tx_pdos = (Pdo(0x1A00, "In", 3, [Entry(0x6000, 1, "In", DataType.UNSIGNED16, 16)]),)


class Simple(Device):
    """Without a mailbox."""

    vendor, product, revision, order = 0x10, 0x21, 0x30, "Simple"


class Bench:
    """A simulation that is driven frame by frame."""

    def __init__(self, *devices, faults=()):
        self.rig = Rig("bench", list(devices) or [Word(), Simple(), Word()])
        self.rig.faults = list(faults)
        self.simulation = Simulation(self.rig)
        self.segment = self.simulation.segment
        self.faults = self.simulation.faults

    def send(self, command, position, address, data):
        """One datagram; its data and working counter, None if the frame was lost."""
        reply = self.segment.process(frame(datagram(command, position, address, data)))
        if reply is None:
            return None
        end = 26 + len(data)
        return reply[26:end], struct.unpack_from("<H", reply, end)[0]

    def read(self, position, address, size):
        return self.send(APRD, -position & 0xFFFF, address, bytes(size))

    def word(self, position, address):
        return int.from_bytes(self.read(position, address, 2)[0], "little")

    def reached(self):
        """How many slaves a broadcast reaches."""
        return self.send(BRD, 0, 0, bytes(1))[1]

    def cycles(self, count, *, each=1):
        """Process data; the simulation makes a step after each so many cycles."""
        answers = []
        for number in range(1, count + 1):
            answers.append(self.send(LRW, 0, 0, bytes(2)))
            if number % each == 0:
                self.simulation.step()
        return answers

    def request(self, position, state):
        """Asks for an AL state; what AL status and code are then."""
        self.send(APWR, -position & 0xFFFF, 0x0120, struct.pack("<H", state))
        self.handle()
        return self.status(position)

    def handle(self):
        for place, event in self.segment.wait(0):
            self.rig.devices[place].handle(event, 0.0)

    def status(self, position):
        return struct.unpack("<HxxH", self.read(position, 0x0130, 6)[0])


@pytest.fixture
def bench():
    made = []

    def make(*devices, faults=()):
        made.append(Bench(*devices, faults=faults))
        return made[-1]

    yield make
    for item in made:
        item.simulation.close()


# --- the schedule ----------------------------------------------------------------------------


def test_a_slave_fault_strikes_at_its_cycle(bench):
    b = bench()
    b.faults.al_error(1, code=0x1D, at_cycle=5)
    b.cycles(4)
    assert b.status(1) == (1, 0)
    b.cycles(1)
    assert b.status(1) == (0x11, 0x1D)
    (state,) = b.faults.list()
    assert (state.struck, state.last_cycle, state.done) == (1, 5, True)


def test_every_and_count(bench):
    b = bench()
    b.faults.al_error(1, code=0x1D, at_cycle=5, every=10, count=3)
    struck = []
    for _ in range(40):
        b.cycles(1)
        struck.append(b.faults.list()[0].struck)
    assert [struck.index(number) + 1 for number in (1, 2, 3)] == [5, 15, 25]
    assert b.faults.list()[0].done


def test_without_a_cycle_it_strikes_at_once_and_then_every_so_many(bench):
    b = bench()
    b.cycles(3)
    b.faults.al_error(1, code=0x1D, every=4, count=0)
    assert b.status(1) == (0x11, 0x1D)
    b.cycles(12)
    (state,) = b.faults.list()
    assert (state.struck, state.last_cycle, state.done) == (4, 15, False)


def strikes(b, seed, each):
    """Cycles in which a fault with probability strikes."""
    number = b.faults.al_error(1, code=1, at_cycle=1, count=0, probability=0.3, seed=seed)
    cycles = []
    for _ in range(0, 200, each):
        b.cycles(each, each=each)
        (state,) = [state for state in b.faults.list() if state.id == number]
        if state.last_cycle not in cycles[-1:]:
            cycles.append(state.last_cycle)
    return cycles, state.struck


def test_the_same_seed_strikes_in_the_same_cycles(bench):
    first, again, other = (strikes(bench(), seed, 1) for seed in (5, 5, 6))
    assert first == again != other
    assert 30 < first[1] < 90
    late = strikes(bench(), 5, 20)
    assert late[1] == first[1], "a simulation that is late leaves none out"
    assert set(late[0]) <= set(first[0])


def test_faults_keep_the_order_of_their_cycles(bench):
    """Also when a step of the simulation finds several of them due."""
    b = bench()
    b.faults.break_link(1, at_cycle=4, every=10, count=2)
    b.faults.heal_link(1, at_cycle=8, every=10, count=2)
    b.cycles(16, each=16)
    assert b.reached() == 1
    b.cycles(2)
    assert b.reached() == 3


def test_a_cycle_that_is_over_is_refused(bench):
    b = bench()
    b.cycles(10)
    with pytest.raises(UsageError, match=naming("al-error", "cycle 5", "cycle 10")):
        b.faults.al_error(0, code=1, at_cycle=5)


def test_faults_of_the_rig(bench):
    b = bench(faults=[parse({"kind": "al-error", "slave": 1, "code": 5, "at_cycle": 2}, "")])
    b.cycles(1)
    assert b.status(1) == (1, 0)
    b.cycles(1)
    assert b.status(1) == (0x11, 5)


def test_cleared_faults_do_not_strike(bench):
    b = bench()
    b.faults.al_error(1, code=5, at_cycle=2)
    b.faults.drop(at_cycle=2)
    kept = b.faults.drop(at_cycle=5)
    assert [b.faults.clear(number) for number in (1, 2)] == [1, 1]
    assert [answer is None for answer in b.cycles(6)] == [False] * 4 + [True, False]
    assert b.status(1) == (1, 0)
    assert [state.id for state in b.faults.list()] == [kept]
    with pytest.raises(UsageError, match=naming("fault 1")):
        b.faults.clear(1)
    b.faults.drop(count=0)
    assert b.faults.clear() == 2
    for _ in range(100):
        b.faults.clear(b.faults.al_error(1, code=5, at_cycle=1000))
    assert len(b.faults._due) == 0, "nothing is left of them"
    assert None not in b.cycles(3)


def test_there_is_an_end_of_faults(bench):
    faults = bench().faults
    for _ in range(MAX_FAULTS):
        faults.al_error(0, code=1, at_cycle=10)
    with pytest.raises(StateError, match=naming(MAX_FAULTS, "faults")):
        faults.al_error(0, code=1)
    faults.clear()
    for _ in range(2 * MAX_FAULTS):
        faults.al_error(0, code=1)
    assert len(faults.list()) < MAX_FAULTS, "those that are done are forgotten"


def test_a_strike_that_fails_later_says_so(bench):
    b = bench()
    b.faults.power_off(1, at_cycle=2)
    number = b.faults.al_error(1, code=1, at_cycle=4, every=2, count=2)
    b.cycles(10)
    (state,) = [state for state in b.faults.list() if state.id == number]
    assert (state.struck, state.done) == (0, True)
    names(state.error, "slave 1", "power", "`power-on`")
    with pytest.raises(StateError, match=naming("slave 1", "power", "`power-on`")):
        b.faults.al_error(1, code=1)


# --- frames ----------------------------------------------------------------------------------


def test_drop_loses_the_frames_of_its_cycles(bench):
    b = bench()
    b.faults.drop(at_cycle=3, every=2, count=3)
    assert [n for n, answer in enumerate(b.cycles(12), 1) if answer is None] == [3, 5, 7]
    (state,) = b.faults.list()
    assert (state.struck, state.done) == (3, True)
    assert b.segment.counters().dropped == 3


def test_frames_without_process_data_are_spared(bench):
    b = bench()
    number = b.faults.drop(count=0)
    assert b.reached() == 3
    assert b.cycles(3) == [None] * 3
    b.faults.clear(number)
    b.faults.drop(count=2, all_frames=True)
    assert [b.send(BRD, 0, 0, bytes(1)) for _ in range(3)] == [None, None, (b"\x11", 3)]


def test_wkc_adds_to_the_working_counter(bench):
    b = bench()
    b.faults.wkc(5, at_cycle=2, count=2)
    assert [answer[1] for answer in b.cycles(4)] == [0, 5, 5, 0]


def test_probability_of_frame_faults_is_seeded(bench):
    runs = []
    for seed in (1, 1, 2):
        b = bench()
        b.faults.drop(count=0, probability=0.3, seed=seed)
        runs.append([answer is None for answer in b.cycles(200)])
    assert runs[0] == runs[1] != runs[2]
    assert 30 < sum(runs[0]) < 90


def test_corrupt_flips_bits(bench):
    b = bench()
    b.faults.corrupt(bits=3, at_cycle=2)
    sent = frame(datagram(LRW, 0, 0, bytes(64)))
    clean, wrong, after = (b.segment.process(sent) for _ in range(3))
    assert clean == after
    flipped = sum((x ^ y).bit_count() for x, y in zip(clean, wrong, strict=True))
    assert flipped == 3


def test_noise_counts_at_the_slave_and_loses_the_frame(bench):
    b = bench()
    b.faults.noise(1, at_cycle=1, count=2)
    assert b.cycles(3) == [None, None, (bytes(2), 0)]
    assert [b.read(i, 0x0300, 2)[0][1] for i in range(3)] == [0, 2, 0], "CRC errors, 0x0301"
    assert b.read(2, 0x0308, 1)[0] == b"\x02", "forwarded errors behind it"


# --- links, power, identity ------------------------------------------------------------------


def test_break_and_heal_a_link(bench):
    b = bench()
    b.send(APWR, 0xFFFE, 0x0010, b"\x03\x10")
    assert b.request(2, 1) == (1, 0)
    b.faults.break_link(2)
    assert b.reached() == 2
    b.faults.heal_link(2)
    assert b.reached() == 3
    assert b.word(2, 0x0010) == 0x1003, "it kept its power, so it kept its station address"
    b.faults.break_link(0, port=1)
    assert b.reached() == 1
    b.faults.heal_link(1)
    assert b.reached() == 3, "both ends are the same cable"


def test_power_cycle(bench):
    b = bench(Simple(), Word(), Simple())
    b.send(APWR, 0xFFFE, 0x0010, b"\x03\x10")
    b.request(2, 2)
    assert b.status(2) == (2, 0)
    b.faults.power_off(2)
    b.simulation.step()
    assert b.reached() == 2
    b.faults.power_off(2)
    b.faults.power_on(2)
    assert b.reached() == 3
    assert b.status(2) == (1, 0)
    assert b.word(2, 0x0010) == 0
    assert b.request(2, 2) == (2, 0)


def test_power_cycle_in_the_middle_of_the_line(bench):
    b = bench()
    b.faults.power_off(1)
    assert b.reached() == 1
    b.faults.power_on(1)
    assert b.reached() == 3


def test_swap(bench):
    b = bench()
    original = b.rig.devices[2]
    b.send(APWR, 0xFFFE, 0x0010, b"\x03\x10")

    def product():
        return words(b, 2, 0x000A)

    assert product() == struct.pack("<I", 0x20)
    b.faults.swap(2, "EL2008")
    b.simulation.step()
    assert product() == struct.pack("<I", 0x07D83052)
    assert b.word(2, 0x0010) == 0
    assert b.request(2, 2) == (2, 0)
    b.faults.swap(2, "original")
    assert b.rig.devices[2] is original
    assert product() == struct.pack("<I", 0x20)
    assert b.status(2) == (1, 0)


def test_swap_for_a_larger_device(bench):
    b = bench()
    b.faults.swap(0, "EL3008")
    b.rig.devices[0][0x6000, 0x11] = 77
    b.simulation.step()
    assert len(b.segment.inputs) >= sum(device.room[1] for device in b.rig.devices)


def test_swaps_in_turn_need_room_only_once(bench):
    b = bench()
    sizes = set()
    for device in ("EL2008", "EL3008", "EL2008", "EL3008", "original"):
        b.faults.swap(0, device)
        sizes.add((len(b.segment.outputs), len(b.segment.inputs)))
    assert len(sizes) <= 2


def test_a_swap_that_fails_changes_nothing(bench, tmp_path):
    b = bench()
    before = b.rig.devices[2]
    (tmp_path / "bad.py").write_text(
        "import ecatsim\n"
        "class Huge(ecatsim.Device):\n"
        "    vendor = product = revision = 1\n"
        "    order = 'Huge'\n"
        "    chip = ecatsim.Chip(ram_kib=100)\n"
        "class Blank(Huge):\n"
        "    def sii_image(self):\n"
        "        return {}[0]\n"
    )
    for name, token in (("Huge", "ram_kib = 100"), ("Blank", "bad.py:8: KeyError")):
        with pytest.raises(UsageError, match=naming(token)):
            b.faults.swap(2, f"{tmp_path / 'bad.py'}:{name}")
    assert b.rig.devices[2] is before
    b.simulation.step()
    assert b.request(2, 3)[1] == 0x13, "it still answers: there is no BOOT"


def test_swap_does_not_wait_for_a_pipe(bench, tmp_path):
    for name in ("pipe.toml", "pipe.bin"):
        os.mkfifo(tmp_path / name)
    (tmp_path / "device.toml").write_text('sii = "pipe.bin"')
    for name in ("pipe.toml", "pipe.bin", "device.toml"):
        with pytest.raises(UsageError, match=r"pipe\.(toml|bin)"):
            bench().faults.swap(0, str(tmp_path / name))


def test_swap_refuses_what_is_no_device(bench, tmp_path):
    b = bench()
    (tmp_path / "bad.bin").write_bytes(b"\x00" * 100)
    (tmp_path / "bad.py").write_text("x = 1")
    for device, tokens in (
        ("EL9999", "EL9999"),
        (str(tmp_path / "none.bin"), "no file | none.bin"),
        (str(tmp_path / "none.toml"), "none.toml | No such file"),
        (str(tmp_path / "none.py:X"), "no file | none.py"),
        (str(tmp_path / "bad.bin"), "bad.bin"),
        (str(tmp_path / "bad.py:x"), "x | class"),
        (str(tmp_path / "bad.py:y"), "bad.py | 'y'"),
        (str(tmp_path / "bad.py"), "bad.py:Class"),
        ("a" * 300 + ".py:X", "File name too long"),
    ):
        with pytest.raises(UsageError, match=naming(*tokens.split(" | "))):
            b.faults.swap(0, device)
    assert b.rig.devices[0].order == "Word"


def test_swap_for_devices_in_files(bench, tmp_path):
    b = bench()
    (tmp_path / "valve.toml").write_text('vendor = 1\nproduct = 2\norder = "Valve"\n')
    (tmp_path / "pump.py").write_text(
        "from ecatsim import Device\nclass Pump(Device):\n    order = 'Pump'\n"
    )
    (tmp_path / "image.bin").write_bytes(b.segment.sii(1))
    found = []
    for device in ("valve.toml", "pump.py:Pump", "image.bin"):
        b.faults.swap(0, str(tmp_path / device))
        found.append(b.rig.devices[0].order)
        assert b.reached() == 3
    assert found == ["Valve", "Pump", "Simple"]


# --- devices ---------------------------------------------------------------------------------


def test_al_error(bench):
    b = bench()
    b.request(1, 2)
    b.faults.al_error(1, 0x8001)
    assert b.status(1) == (0x12, 0x8001), "already below SAFEOP"
    assert b.request(1, 0x12) == (2, 0), "acknowledged"
    b.faults.al_error(1, 0x8001, "INIT")
    assert b.status(1) == (0x11, 0x8001)


def test_a_mailbox_is_needed(bench):
    faults = bench().faults
    with pytest.raises(UsageError, match=naming("emergency", "slave 1 (Simple)", "mailbox")):
        faults.emergency(1, 0x8130)
    with pytest.raises(UsageError, match=naming("mailbox: slave 1 (Simple)", "no mailbox")):
        faults.mailbox(1, "stuck")


def eeprom(b, position, size=256):
    """The SII image as a master reads it."""
    image = b""
    for word in range(0, size // 2, 2):
        image += words(b, position, word)
    return image


def words(b, position, word):
    """Two words of the SII."""
    b.send(APWR, -position & 0xFFFF, 0x0502, struct.pack("<HI", 0x0100, word))
    while b.read(position, 0x0503, 1)[0][0] & 0x80:
        pass  # it is busy
    return b.read(position, 0x0508, 4)[0]


def test_eeprom(bench, tmp_path):
    b = bench()
    original = eeprom(b, 0)
    b.faults.eeprom(0, "ones")
    assert eeprom(b, 0) == b"\xff" * 256
    b.faults.eeprom(0, "checksum")
    changed = [i for i, (x, y) in enumerate(zip(original, eeprom(b, 0), strict=True)) if x != y]
    assert changed == [14]
    b.faults.eeprom(0, "truncated")
    assert eeprom(b, 0)[:128] == original[:128]
    assert eeprom(b, 0)[128:] != original[128:]
    file = tmp_path / "other.bin"
    file.write_bytes(bytes(range(256)))
    b.faults.eeprom(0, "image", str(file))
    assert eeprom(b, 0) == bytes(range(256))
    b.faults.eeprom(0, "restore")
    assert eeprom(b, 0) == original
    with pytest.raises(UsageError, match=naming("no file", "none.bin")):
        b.faults.eeprom(0, "image", str(tmp_path / "none.bin"))


def test_eeprom_at_power_on(bench):
    b = bench()
    original = eeprom(b, 2)
    b.faults.eeprom(2, "checksum", at_power_on=True)
    assert eeprom(b, 2) == original
    assert b.read(2, 0x0503, 1)[0][0] & 0x08 == 0
    b.faults.power_off(2)
    b.faults.power_on(2)
    assert eeprom(b, 2) != original
    assert b.read(2, 0x0503, 1)[0][0] & 0x08, "the checksum is wrong"


def test_to_look_at_a_slave_changes_nothing(bench):
    b = bench()
    b.send(APWR, 0, 0x0120, b"\x02\x00")
    assert b.segment.peek(0, 0x0120, 2) == b"\x02\x00"
    assert b.segment.peek(0, 0x0220, 1)[0] & 1, "AL event request: AL control, still pending"
    assert b.segment.read(0, 0x0120, 2) == b"\x02\x00"
    assert not b.segment.peek(0, 0x0220, 1)[0] & 1, "the device has acknowledged it"


def test_faults_from_another_thread(bench):
    """The methods wait for the step that is under way, and the loop for them."""
    b = bench()
    done = threading.Event()
    loop = threading.Thread(target=b.simulation.run, args=(done.is_set,))
    loop.start()
    try:
        for number in range(200):
            b.faults.al_error(0, 0x8000 + number)
            b.faults.power_off(2)
            b.faults.swap(1, "EL1008")
            b.faults.power_on(2)
            b.faults.swap(1, "original")
            assert b.status(0) == (0x11, 0x8000 + number)
        assert b.reached() == 3
    finally:
        done.set()
        loop.join()


def test_clock(bench):
    class NoClock(Simple):
        chip = Chip(dc=False)

    b = bench(Word(), Word(), NoClock())
    before = b.segment.clocks()
    b.faults.clock(1, step_ns=3_000_000_000_000)
    after = b.segment.clocks()
    moved = [late.local_ns - early.local_ns for early, late in zip(before, after, strict=True)]
    assert moved[1] - moved[0] == 3_000_000_000_000
    b.faults.clock(1, drift_ppm=500.0)
    one = b.segment.clocks()
    while (two := b.segment.clocks())[0].local_ns - one[0].local_ns < 20_000_000:
        pass
    passed = [late.local_ns - early.local_ns for early, late in zip(one, two, strict=True)]
    assert passed[1] - passed[0] == pytest.approx(500e-6 * passed[0], abs=20)
    with pytest.raises(UsageError, match=naming("clock: slave 2 (Simple)", "distributed clock")):
        b.faults.clock(2, step_ns=1)


class Sensors(Device):
    """A signed, an unsigned and a real input, and a switch."""

    vendor, product, revision, order = 0x10, 0x22, 0x30, "Sensors"
    tx_pdos = (
        Pdo(
            0x1A00,
            "In",
            3,
            [
                Entry(0x6000, 1, "Temperature", DataType.INTEGER16, 16),
                Entry(0x6000, 2, "Level", DataType.UNSIGNED8, 8),
                Entry(0x6000, 3, "Flow", DataType.REAL32, 32),
                Entry(0x6000, 4, "Switch", DataType.BOOLEAN, 1),
            ],
        ),
    )


def test_a_sensor_drifts_until_it_is_true_again(bench):
    b = bench(Sensors())
    device = b.rig.devices[0]
    device[0x6000, 1], device[0x6000, 2], device[0x6000, 3] = -5, 250, 0.5

    def given(now):
        """What the device gives in SAFEOP at a time."""
        data = device._drifted(device.give(), now)
        return struct.unpack("<hBf", data[:7])

    assert given(0) == (-5, 250, 0.5)
    b.faults.drift(0, "0x6000:01", per_second=-10, limit=100)
    b.faults.drift(0, "0x6000:02", per_second=1)
    b.faults.drift(0, "0x6000:03", per_second=0.25)
    assert not device.sleeps
    assert given(100) == (-5, 250, 0.5)  # it begins
    assert given(104) == (-45, 254, 1.5)
    assert given(200) == (-105, 255, 25.5)  # at its limit, and at the end of the type
    device[0x6000, 1] = 7
    assert given(200)[0] == -93  # the plant goes on
    assert device[0x6000, 1] == 7  # objects keep the true value
    b.faults.drift(0, "0x6000:01", per_second=0)
    assert given(200)[0] == 7
    for entry, words in (
        ("0x6000:04", ("no numbers", "0x6000:01")),
        ("0x7000:01", ("no mapped input", "0x6000:03")),
        ("6000", ("no address", "0x6000:01")),
    ):
        with pytest.raises(UsageError, match=naming(*words)):
            b.faults.drift(0, entry, per_second=1)
