"""Outputs without an owner, on the daemon: a drive is braked, ranges hold, and all has a reason.

The motor of the rig `troll` is simulated: with no power it runs on until friction stops it, with
the ramp that `brake_slowly` sets it would take a second.
"""

import ctypes
import struct
import threading
import time
from collections.abc import Callable

import pytest

from conftest import SHM, Daemon, names, naming, one_line_error, run_module, wait_for
from ecatd.base.errors import StateError, UnreachableError, UsageError
from ecatd.shm import contract as shm

pytestmark = [pytest.mark.bus, pytest.mark.long]

DRIVE, EL2008 = 0, 3
SPEED = 200_000
READY, SWITCHED_ON, ENABLED, DISABLED, QUICK_STOP = 0x21, 0x23, 0x27, 0x40, 0x07
BASE = "[gateway]\nlisten = []\n"
# A busy machine may exchange nothing for longer than the usual 100 ms.
WATCHDOG = "[[slave]]\nposition = 0\nwatchdog_ms = 1000\n"


def stop_rule(value: str, more: str = "") -> str:
    base = f"{BASE}{WATCHDOG}{more}"
    return f"{base}[[outputs.safe]]\nslave = 0\nvalue = '{value}'\nstop_timeout_s = 10\n"


class Drive:
    """A client that owns the drive, and what it saw in its last sample."""

    def __init__(self, daemon: Daemon, lease: float = 30.0) -> None:
        self.daemon = daemon
        self.client = daemon.client()
        self._lease = lease

    def __enter__(self) -> "Drive":
        return self

    def __exit__(self, *_: object) -> None:
        self.client.close()

    def get(self, index: int) -> int:
        return int(self.client.signal(DRIVE, index).raw)

    def put(self, index: int, value: int) -> None:
        self.client.signal(DRIVE, index).raw = value

    @property
    def state(self) -> int:
        """The state bits of the statusword (CiA 402)."""
        bits = self.get(0x6041) & 0x6F
        return DISABLED if bits & 0x4F == DISABLED else bits

    @property
    def control(self) -> int:
        return self.get(0x6040)

    @property
    def speed(self) -> int:
        return abs(self.get(0x606C))

    def step(self, *, commit: bool = False) -> None:
        self.client.wait(1, timeout=30)
        self.client.sample()
        if commit:
            self.client.commit()

    def until(self, condition: Callable[[], bool], *, commit: bool = False) -> None:
        for _ in range(20000):
            self.step(commit=commit)
            if condition():
                return
        pytest.fail(f"control {self.control:#x}, status {self.state:#x}, speed {self.speed}")

    def sdo(self, index: int, data: bytes) -> None:
        self.client.sdo_download(DRIVE, index, 0, data).result()

    def brake_slowly(self) -> None:
        """Quick stop and disable operation follow ramps, which take a second from `SPEED`."""
        self.sdo(0x6084, struct.pack("<I", SPEED))
        self.sdo(0x6085, struct.pack("<I", SPEED))
        self.sdo(0x605C, struct.pack("<h", 1))

    def run(self) -> None:
        """Takes the drive over and up to speed, in cyclic synchronous velocity mode."""
        self.claim = self.client.claim(DRIVE, lease=self._lease)
        self.put(0x6060, 9)
        self.put(0x60FF, SPEED)
        self.put(0x6072, 1000)
        for word, state in ((6, READY), (7, SWITCHED_ON), (15, ENABLED)):
            self.put(0x6040, word)
            self.until(lambda wanted=state: self.state == wanted, commit=True)  # type: ignore[misc]
        self.until(lambda: self.speed > 0.95 * SPEED, commit=True)

    def until_off(self) -> tuple[set[int], int]:
        """Watches the drive come to a stop: controlwords while it moves, and its speed after."""
        words: set[int] = set()

        def off() -> bool:
            if self.state in (ENABLED, QUICK_STOP):
                words.add(self.control)
            return self.state not in (ENABLED, QUICK_STOP)

        self.until(off)
        return words, self.speed

    def output(self, index: int = 0x6040) -> tuple[shm.Outputs, shm.Reason, int]:
        """State, reason and cycle of an output, as they are published."""
        data = (SHM / self.daemon.bus).read_bytes()
        header = shm.struct("ecat_shm_header").from_buffer_copy(data)
        number = self.client.signal(DRIVE, index).number
        size = ctypes.sizeof(shm.struct("ecat_shm_output"))
        row = shm.struct("ecat_shm_output").from_buffer_copy(
            data, header.outputs_offset + number * size
        )
        assert 0 < row.since_ns <= time.monotonic_ns()
        return shm.Outputs(row.state), shm.Reason(row.reason), row.since_cycle


@pytest.fixture(scope="module")
def braking(tmp_path_factory: pytest.TempPathFactory) -> object:
    """A daemon that stops the drive with a quick stop."""
    daemon = Daemon(tmp_path_factory.mktemp("d"), "troll", config=stop_rule("quick_stop"))
    daemon.wait_ready()
    with Drive(daemon) as drive:
        drive.brake_slowly()
    yield daemon
    daemon.close()


def test_without_a_rule_the_motor_runs_on(start_daemon: Callable[..., Daemon]) -> None:
    """What the other tests would see if nothing were sequenced."""
    with Drive(start_daemon("troll")) as drive:
        drive.brake_slowly()
        drive.run()
        drive.claim.release()
        assert drive.until_off()[1] > SPEED / 2


def test_a_released_drive_is_braked_before_it_loses_its_power(braking: Daemon) -> None:
    with Drive(braking) as drive:
        assert drive.output(0x6072)[:2] == (shm.Outputs.SAFE, shm.Reason.START)
        drive.run()
        assert drive.output()[:2] == (shm.Outputs.ACTIVE, shm.Reason.START)
        drive.claim.release()
        drive.until(lambda: drive.state == QUICK_STOP)
        assert drive.output()[:2] == (shm.Outputs.STOPPING, shm.Reason.RELEASED)
        # What moves it is zero, what shapes its stop is as it was.
        assert [drive.get(i) for i in (0x60FF, 0x6071, 0x6060, 0x6072)] == [0, 0, 9, 1000]
        words, speed = drive.until_off()
        assert words == {0x0002}
        assert speed < SPEED / 50
        drive.until(lambda: drive.control == 0)
        drive.until(lambda: drive.output()[:2] == (shm.Outputs.SAFE, shm.Reason.RELEASED))
        drive.run()  # and a new owner goes on
        drive.claim.release()
        drive.until_off()
    wait_for(lambda: braking.log.count("has stopped") >= 2, braking)


def test_a_drive_of_a_client_that_hangs_is_braked(braking: Daemon) -> None:
    with Drive(braking, lease=2.0) as owner, Drive(braking) as other:
        owner.run()
        words, speed = other.until_off()  # meanwhile the owner does nothing
        assert words - {15} == {0x0002}
        assert speed < SPEED / 50
        other.until(lambda: other.output()[:2] == (shm.Outputs.SAFE, shm.Reason.LAPSED))


def test_a_new_owner_takes_over_while_the_drive_is_stopped(braking: Daemon) -> None:
    with Drive(braking) as owner, Drive(braking) as heir:
        owner.run()
        owner.client.close()
        heir.until(lambda: heir.state == QUICK_STOP)
        claim = heir.client.claim(DRIVE, lease=30.0)
        heir.until(lambda: heir.output()[0] == shm.Outputs.CLAIMED)
        assert (heir.control, heir.state) == (0x0002, QUICK_STOP)  # a claim alone ends nothing
        heir.put(0x6040, 0)
        heir.until(lambda: heir.output()[0] == shm.Outputs.ACTIVE, commit=True)
        heir.until(lambda: heir.control == 0 and heir.state == DISABLED, commit=True)
        assert heir.speed > SPEED / 50  # the owner wanted it so
        claim.release()


def test_a_stop_goes_on_under_an_owner_that_writes_nothing(braking: Daemon) -> None:
    with Drive(braking) as owner, Drive(braking) as heir:
        owner.run()
        owner.client.close()
        heir.client.claim(DRIVE, lease=30.0)
        words, speed = heir.until_off()
        assert words - {15} == {0x0002}
        assert speed < SPEED / 50
        heir.until(lambda: heir.control == 0)
        assert heir.output()[0] == shm.Outputs.CLAIMED


def test_disable_operation_brakes_too(start_daemon: Callable[..., Daemon]) -> None:
    with Drive(start_daemon("troll", config=stop_rule("disable"))) as drive:
        drive.brake_slowly()
        drive.run()
        drive.claim.release()
        words, speed = drive.until_off()
        assert words - {15} == {0x0007}
        assert speed < SPEED / 50
        drive.until(lambda: drive.control == 0)


def test_a_drive_that_stays_in_quick_stop_has_its_time(start_daemon: Callable[..., Daemon]) -> None:
    config = stop_rule("quick_stop").replace("stop_timeout_s = 10", "stop_timeout_s = 0.3")
    daemon = start_daemon("troll", config=config)
    with Drive(daemon) as drive:
        drive.sdo(0x605A, struct.pack("<h", 6))
        drive.run()
        drive.claim.release()
        drive.until(lambda: drive.control == 0)
        drive.until(lambda: drive.output()[0] == shm.Outputs.SAFE)
    wait_for(lambda: "has not stopped" in daemon.log, daemon)


@pytest.mark.parametrize("value", ["quick_stop", "disable"])
def test_r23_the_daemon_stops_the_drive_before_slaves_leave_op(
    start_daemon: Callable[..., Daemon], value: str
) -> None:
    daemon = start_daemon("troll", config=stop_rule(value))
    with Drive(daemon) as drive, daemon.client() as rival:
        drive.brake_slowly()
        drive.run()
        daemon.process.terminate()
        last, refused = (0, 0, 0), False
        with pytest.raises(UnreachableError):
            while True:
                drive.step()
                domain = drive.client.domain()
                if domain.wkc == domain.wkc_expected:  # all slaves are in OP
                    last = (drive.state, drive.control, drive.speed)
                    if drive.state == QUICK_STOP and not refused:
                        with pytest.raises(UnreachableError, match="stop"):
                            rival.claim(EL2008)  # nothing is given away any more
                        refused = True
        assert last[0] not in (ENABLED, QUICK_STOP)
        assert last[1] == 0
        assert last[2] < SPEED / 50
        assert refused == (value == "quick_stop")
    assert daemon.process.wait() == 0


def break_link(daemon: Daemon, name: str = "break-link") -> threading.Thread:
    """Cuts the cable in front of slave 5, or mends it."""
    simulator = str(daemon.child_pid("ecatsim"))
    command = ("ecatsim", "ctl", "--name", simulator, name, "5")
    thread = threading.Thread(target=run_module, args=command)
    thread.start()
    return thread


def test_outputs_fall_when_slaves_no_longer_take_part(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll", config=stop_rule("quick_stop", "[outputs]\nwkc_limit = 5\n"))
    with Drive(daemon) as drive, Drive(daemon) as other:
        drive.brake_slowly()
        drive.run()
        cut = break_link(daemon)
        with pytest.raises(StateError, match=naming("take part")):
            drive.until(lambda: False, commit=True)
        assert other.output()[1] == shm.Reason.WKC
        cut.join()
        break_link(daemon, "heal-link").join()
        _words, speed = other.until_off()
        assert speed < SPEED / 50
        other.run()  # a new claim of a complete bus
    wait_for(lambda: "wrong working counters in a row" in daemon.log, daemon)


def test_without_a_limit_wrong_working_counters_change_nothing(
    start_daemon: Callable[..., Daemon],
) -> None:
    daemon = start_daemon("troll")
    with Drive(daemon) as drive:
        drive.client.claim(DRIVE, lease=30.0)
        drive.put(0x6060, 9)
        cut = break_link(daemon)
        wrong = shm.WkcState.INCOMPLETE
        for _ in range(50):
            drive.until(lambda: drive.client.domain().wkc_state == wrong, commit=True)
        assert drive.output(0x6060)[0] == shm.Outputs.ACTIVE
        cut.join()


def test_a_start_with_a_stop_for_no_drive_ends_with_a_sentence(
    start_daemon: Callable[..., Daemon],
) -> None:
    config = stop_rule("quick_stop").replace("slave = 0", "slave = 3")
    status, log = start_daemon("troll", ready=False, config=config).wait_end()
    assert status == 2
    said = one_line_error(log, "ecatd")
    names(said, "outputs.safe", '"quick_stop"', "controlword", "slave 3 (EL2008)")


RANGE = """
[[signal]]
slave = 0
entry = "0x60FF:00"
name = "speed"
unit = "rpm"
scale = 0.1
minimum = -30.0
maximum = 30.0
"""


def test_declared_signals_reach_clients_and_hold(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll", config=BASE + RANGE)
    with daemon.client() as client:
        speed = client.signal(DRIVE, 0x60FF)
        assert (speed.name, speed.unit, speed.scale, speed.offset) == ("speed", "rpm", 0.1, 0.0)
        assert (speed.minimum, speed.maximum) == (-300, 300)
        client.claim(DRIVE, lease=30.0)
        speed.value = 30.0
        with pytest.raises(UsageError, match=naming(301, "out of range", "0x60FF:00", -300, 300)):
            speed.raw = 301
    text = daemon.ctl("pdos", "0").stdout
    assert "0x60FF:00  32 bit  INTEGER32   speed  [rpm = raw * 0.1, -30 to 30, safe 0]" in text
    (slave,) = daemon.ctl_json("pdos", "0")["slaves"]
    entries = {e["index"]: e for pdo in slave["outputs"] for e in pdo["entries"]}
    assert {key: entries[0x60FF][key] for key in ("unit", "minimum", "maximum", "safe")} == {
        "unit": "rpm",
        "minimum": -30.0,
        "maximum": 30.0,
        "safe": 0,
    }
