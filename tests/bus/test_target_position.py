"""A target position that no client has written follows the actual position."""

from collections.abc import Callable

import pytest
from test_safe_stop import BASE, SPEED, WATCHDOG, Drive

from conftest import Daemon, wait_for
from ecatd.shm import contract as shm

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

TARGET, ACTUAL = 0x607A, 0x6064
ENABLED = 0x27


def enable(drive: Drive, mode: int) -> None:
    """Enables the drive without a target."""
    drive.put(0x6060, mode)
    drive.put(0x6072, 1000)
    for word, state in ((6, 0x21), (7, 0x23), (15, ENABLED)):
        drive.put(0x6040, word)
        drive.until(lambda wanted=state: drive.state == wanted, commit=True)  # type: ignore[misc]


def test_a_drive_that_is_enabled_without_a_target_stays_where_it_is(
    start_daemon: Callable[..., Daemon],
) -> None:
    daemon = start_daemon("troll", config=BASE + WATCHDOG)
    with Drive(daemon) as drive:
        drive.run()
        drive.until(lambda: drive.get(ACTUAL) > SPEED, commit=True)
        assert abs(drive.get(TARGET) - drive.get(ACTUAL)) < SPEED  # within some cycles
        assert drive.get(TARGET) > 0
        drive.claim.release()
        drive.until(lambda: drive.speed == 0 and drive.get(TARGET) == drive.get(ACTUAL))
        rest = drive.get(ACTUAL)
        assert rest > SPEED
    with Drive(daemon) as drive:
        drive.step()
        assert drive.output(TARGET)[0] is shm.Outputs.SAFE
        drive.claim = drive.client.claim(0, lease=30)
        enable(drive, 8)
        for _ in range(100):
            drive.step(commit=True)
            assert abs(drive.get(ACTUAL) - rest) < SPEED / 100
        assert drive.output(TARGET)[0] is shm.Outputs.CLAIMED
        # Once it is written, it is the client's.
        drive.put(TARGET, rest + 2000)
        drive.until(lambda: drive.get(ACTUAL) == rest + 2000, commit=True)
        assert drive.output(TARGET)[0] is shm.Outputs.ACTIVE
        drive.put(TARGET, rest - 2000)
        drive.until(lambda: drive.get(ACTUAL) == rest - 2000, commit=True)
        drive.claim.release()
        drive.until(lambda: drive.output(TARGET)[0] is shm.Outputs.SAFE)
        drive.until(lambda: drive.speed == 0 and drive.get(TARGET) == drive.get(ACTUAL))
        # What was valid last stays while the input is not valid.
        last = drive.get(TARGET)
        daemon.ctl("state", "0", "PREOP", "--yes")
        wait_for(lambda: daemon.slave_rows("state")[0]["text"] == "PREOP", daemon)
        for _ in range(20):
            drive.step()
            assert drive.get(TARGET) == last != 0
    (row,) = (
        row
        for pdo in daemon.ctl_json("pdos")["slaves"][0]["outputs"]
        for row in pdo["entries"]
        if row["index"] == TARGET
    )
    assert row["safe"] == "actual"


def test_a_rule_for_the_target_position_wins(start_daemon: Callable[..., Daemon]) -> None:
    rule = "[[outputs.safe]]\nslave = 0\nentry = '0x607A:00'\nvalue = 1234\n"
    with Drive(start_daemon("troll", config=BASE + WATCHDOG + rule)) as drive:
        drive.run()
        drive.until(lambda: drive.get(ACTUAL) > SPEED / 10, commit=True)
        assert drive.get(TARGET) == 1234
