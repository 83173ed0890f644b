"""The drives of manufacturers: each differs from the standard as its file says."""

import pytest
from drive_bench import BIT_12, BIT_13, IMMEDIATELY, NEW, REACHED, Bench

from ecatd.base.errors import ConfigError
from ecatd.etg.error_codes import SdoAbortError
from ecatsim.devices import drives
from ecatsim.files import any_device, drive_file

DONE = BIT_12 | REACHED
HOMED = 1 << 15
RPM, PP, PV, PT, HM, IP, CSP, CSV = 60, 1, 3, 4, 6, 7, 8, 9


def write(bench, index, value, subindex=0):
    """Writes an object as a master does."""
    bench.drive.dictionary.entry(index, subindex).write(
        value.to_bytes(
            bench.drive.dictionary.entry(index, subindex).bits // 8, "little", signed=value < 0
        )
    )


def has(bench, index):
    return index in bench.drive.dictionary


@pytest.mark.parametrize("name", drives.NAMES)
def test_each_profile_tells_its_sources(name):
    kind = drives.kind(name)
    assert kind.sources
    assert kind.units
    assert kind.deviations
    for item in (*kind.units, *kind.deviations):
        assert item.source


@pytest.mark.parametrize(
    ("name", "modes"),
    [("ElmoGold", 0x3ED), ("EPOS4", 0x3A5), ("AKD", 0xED), ("Circulo", 0x303AD)],
)
def test_supported_modes_and_homing_methods(name, modes):
    bench = Bench(name)
    assert bench[0x6502] == modes
    if has(bench, 0x60E3):
        listed = [bench[0x60E3, number + 1] for number in range(bench[0x60E3])]
        assert tuple(listed) == bench.drive.options.homing.methods
    assert has(bench, 0x60E3) == (name in ("ElmoGold", "EPOS4"))


@pytest.mark.parametrize(
    ("name", "accepted"),
    [
        ("ElmoGold", {0, 1, 2, 3, 5, 6, 7}),
        ("EPOS4", {6}),
        ("Circulo", {0, 2, 6, 9}),
    ],
)
def test_quick_stop_options(name, accepted):
    bench = Bench(name)
    assert bench[0x605A] in accepted
    for code in range(10):
        if code in accepted:
            write(bench, 0x605A, code)
        else:
            with pytest.raises(SdoAbortError):
                write(bench, 0x605A, code)


def test_a_mode_that_a_drive_does_not_have_is_refused():
    bench = Bench("EPOS4").enable(PV)
    with pytest.raises(SdoAbortError):
        write(bench, 0x6060, PT)
    assert bench.set(mode=PT).run(0.01)[0x6061] == PV, "in the process data it has no effect"


@pytest.mark.parametrize("name", ["EPOS4", "Circulo"])
def test_speeds_are_in_revolutions_a_minute(name):
    bench = Bench(name).enable(CSV)
    bench.set(speed=300).run(1.0)
    turn = bench.drive.axis.encoder
    assert bench.drive.axis.speed == pytest.approx(5 * turn, rel=0.01)
    assert bench.speed == pytest.approx(300, abs=3)
    assert bench[0x60A9] == 0x00B44700
    bench[0x6083] = bench[0x6084] = 600  # rpm/s
    bench.set(mode=PV, speed=0).run(0.25)
    assert bench.speed == pytest.approx(150, abs=5)


@pytest.mark.parametrize("name", ["EPOS4", "AKD"])
def test_a_quick_stop_keeps_power_until_it_is_cancelled(name):
    bench = Bench(name)
    bench[0x6085] = bench.drive.axis.encoder * 10 if name == "AKD" else 6000
    mode = PV if name == "AKD" else CSV
    bench.enable(mode).set(speed=60 if name == "EPOS4" else 1 << 20).run(1.0)
    bench.set(word=0x0B).until(lambda b: b.state == 0x07).run(1.0)
    assert bench.state == 0x07
    assert bench.speed == pytest.approx(0, abs=2)
    assert bench.set(word=0x0F, speed=0).run(0.01).state == 0x27


# --- EPOS4 ---------------------------------------------------------------------------------------


def epos4(method, *, move=0, position=0, **parameters):
    bench = Bench("EPOS4", **parameters)
    bench.drive.motor.position = 0.3 * 2 * 3.141592653589793
    bench[0x6098], bench[0x30B1], bench[0x30B0] = method, move, position
    bench[0x6099, 1], bench[0x6099, 2], bench[0x609A] = 4 * RPM, RPM, 2000
    return bench.enable(HM)


@pytest.mark.parametrize(
    ("method", "reference", "away"), [(-4, -2.5, 1), (-3, 2.5, -1), (-1, 2.0, -1), (23, 1.0, -1)]
)
def test_an_epos4_moves_away_from_its_reference(method, reference, away):
    """The position 0x30B0 is that of the place where it ends; bit 15 tells that it is homed."""
    bench = epos4(method, move=3000, position=500, stops=2.5, travel=20.0, home=1.5)
    assert not bench.status & HOMED
    bench.set(word=0x1F).until(lambda b: b.status & DONE == DONE, 20.0).run(0.2)
    assert bench.status & HOMED
    machine = bench.drive.axis.machine
    assert machine == pytest.approx(reference * 4096 + away * 3000, abs=200)
    assert bench.position - 500 == pytest.approx(machine - reference * 4096 - away * 3000, abs=1.5)


def test_a_limit_switch_of_an_epos4_is_a_fault_outside_of_homing():
    bench = Bench("EPOS4", travel=2.0).enable(CSV)
    bench.set(speed=-120).until(lambda b: b.state == 0x08)
    assert bench[0x603F] == 0x8A80
    bench = epos4(17, travel=2.0)
    bench.set(word=0x1F).until(lambda b: b.status & DONE == DONE, 20.0)
    assert bench[0x603F] == 0


# --- AKD -----------------------------------------------------------------------------------------


def test_an_akd_has_torque_in_switched_on_and_follows_interpolated_positions():
    bench = Bench("AKD").set(mode=IP)
    for word in (0x06, 0x07):
        bench.set(word=word).run(0.01)
    assert bench.state == 0x23
    bench.drive.motor.speed = 5.0
    assert bench.run(0.5).drive.axis.speed == pytest.approx(0, abs=1), "it is held"
    bench[0x60C1, 1] = bench[0x6063]
    bench.set(word=0x0F).run(0.1)
    assert bench.status & BIT_12, "interpolated position is active"
    for _ in range(500):
        bench[0x60C1, 1] += 1000
        bench.run(0.002)
    assert bench.run(0.5)[0x6063] == pytest.approx(bench[0x60C1, 1], abs=500)
    assert bench[0x6063] == bench.position
    assert bench.drive.axis.encoder == 1 << 20


def test_the_homing_methods_of_an_akd_are_not_known():
    bench = Bench("AKD").enable(HM)
    bench[0x6098] = 35
    assert bench.set(word=0x1F).run(0.1).status & BIT_13


# --- Circulo -------------------------------------------------------------------------------------


def test_a_circulo_has_no_option_codes_but_that_of_the_quick_stop():
    bench = Bench("Circulo")
    for index in (0x605B, 0x605C, 0x605D, 0x605E, 0x607F, 0x608F, 0x60E3):
        with pytest.raises(SdoAbortError):
            bench.drive.dictionary.entry(index, 0)
    bench.enable(CSV).set(speed=300).run(0.5)
    bench[0x6085] = 600
    write(bench, 0x605A, 9)
    bench.set(word=0x0B).until(lambda b: b.state == 0x40)
    assert bench.now < 1.0, "short-circuited, not on its ramp of half a second"


def test_a_circulo_does_not_move_before_its_ramps_are_set():
    bench = Bench("Circulo").enable(PP)
    bench.set(position=100_000, word=0x0F | NEW).run(0.5)
    assert bench.position == pytest.approx(0, abs=5)
    assert bench.status & REACHED, "its window is off"
    bench[0x6081], bench[0x6083], bench[0x6084], bench[0x6067] = 300, 3000, 3000, 100
    bench.run(0.01)
    assert not bench.status & REACHED
    bench.set(word=0x0F).run(0.01).set(word=0x0F | NEW | IMMEDIATELY)
    bench.until(lambda b: b.status & REACHED)
    assert bench.position == pytest.approx(100_000, abs=100)


@pytest.mark.parametrize(
    ("method", "reference"), [(-1, -2.0), (-2, 2.0), (-3, -2.5 + 0.125), (-4, 2.5 - 0.125)]
)
def test_a_circulo_finds_its_end_stop_by_torque(method, reference):
    bench = Bench("Circulo", stops=2.5)
    bench[0x6098], bench[0x2005, 3], bench[0x2005, 4] = method, 600, 65535
    bench[0x6099, 1], bench[0x6099, 2], bench[0x609A] = 120, 60, 2000
    bench.enable(HM).set(word=0x1F).until(lambda b: b.status & DONE == DONE, 20.0).run(0.2)
    machine = bench.drive.axis.machine
    assert bench.position == pytest.approx(machine - reference * 524288, abs=2)


def test_a_touch_probe_of_a_circulo_takes_its_input_only():
    bench = Bench("Circulo", travel=20.0, home=2.0).enable(CSV)
    bench[0x60B8] = 0x0015 | 0x1500  # by the index pulse, and probe 2
    bench.set(speed=300).until(lambda b: b[0x60B9] & 2)
    assert bench[0x60BA] == 1.5 * 524288, "the edge of the home switch"
    assert bench[0x60B9] == 0x0003, "there is no second probe"


# --- Elmo Gold -----------------------------------------------------------------------------------


@pytest.mark.parametrize("method", [-1, -2, -3, -4])
def test_what_the_negative_methods_of_an_elmo_gold_do_is_not_known(method):
    bench = Bench("ElmoGold", stops=2.5).enable(HM)
    assert method in [bench[0x60E3, number + 1] for number in range(bench[0x60E3])]
    bench[0x6098] = method
    assert bench.set(word=0x1F).run(0.1).status & BIT_13


# --- files ---------------------------------------------------------------------------------------


DRIVE = """
vendor = 0xFFFF
product = 0x500
name = "Spindle"

[mailbox]

[drive]
description = "Spindle drive"
modes = [0, 3]
quick_stop = [0, 2]

[[pdo]]
index = 0x1600
entry = [{ index = 0x6040, name = "Controlword", type = "uint16" }]
"""


def test_a_drive_of_ones_own(tmp_path):
    path = tmp_path / "spindle.toml"
    path.write_text(DRIVE)
    drive = any_device.load(path)
    assert drive[0x6502, 0] == 0x04
    assert drive.order == "Spindle"
    for wrong, words in (
        ("quick_stop = [0, 2]", "quick_stop = [-1]"),
        ("modes = [0, 3]", "modes = [5]"),
        ("modes = [0, 3]", "limit_faults = [1]"),
        ("modes = [0, 3]", "nonsense = 1"),
    ):
        path.write_text(DRIVE.replace(wrong, words))
        with pytest.raises(ConfigError, match=r"spindle\.toml:1[01]"):
            drive_file.load(path)
    path.write_text(DRIVE.replace("[drive]", "[[deviation]]").split("description")[0])
    with pytest.raises(ConfigError, match="deviation"):
        any_device.load(path)
