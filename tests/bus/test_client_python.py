"""The Python client on a real bus: entries, claims, requests, restarts of the daemon."""

import os
import time
from collections.abc import Callable

import pytest

from conftest import Daemon
from ecatd import LeaseError, OwnedError, SdoAbortError, UnreachableError
from ecatd.client import Client, Outputs, Reason, Signal, Validity
from ecatd.model.errors import NoAnswerError, StateError, UsageError

pytestmark = [pytest.mark.bus, pytest.mark.unprivileged]

DRIVE, EL1018, EL2008 = 0, 2, 3


def channel(bus: Client, number: int) -> tuple[Signal, Signal]:
    """An output of the EL2008 and the input of the EL1018 that it is wired to."""
    return bus.signal(EL2008, 0x7000 + 16 * number, 1), bus.signal(EL1018, 0x6000 + 16 * number, 1)


def come(bus: Client, condition: Callable[[], bool]) -> None:
    """Waits until a sample shows something."""
    for _ in range(3000):
        bus.wait()
        bus.sample()
        if condition():
            return
    pytest.fail("it does not come about")


def test_a_value_goes_out_and_comes_back(troll: Daemon) -> None:
    with troll.client() as bus:
        output, level = channel(bus, 0)
        with bus.claim(EL2008, lease=0.5) as claim:
            assert output in claim.outputs
            assert len(claim.outputs) == 8
            for value in (1, 0, True):
                output.raw = value
                bus.commit()
                come(bus, lambda value=value: level.raw == value)  # type: ignore[misc]
            assert level.validity is Validity.VALID
            assert bus.output(output).owned
            assert bus.output(output).state is Outputs.ACTIVE
        info = bus.output(output)
        assert (info.owner, info.state, info.reason) == (None, Outputs.SAFE, Reason.RELEASED)
        with pytest.raises(StateError, match="must be claimed"):
            output.raw = 1
        with pytest.raises(UsageError, match="is an input"):
            level.raw = 1


def test_entries_of_one_slave_belong_to_two_clients(troll: Daemon) -> None:
    with troll.client() as first, troll.client() as second, troll.client() as reader:
        mine, mine_back = channel(first, 1)
        theirs, theirs_back = channel(second, 2)
        with first.claim(mine, lease=0.5), second.claim(f"{EL2008}/0x7020:01", lease=0.5):
            mine.raw = theirs.raw = 1
            first.commit()
            second.commit()
            come(first, lambda: (second.sample(), mine_back.raw)[1] == 1)  # type: ignore[func-returns-value]
            come(second, lambda: (first.sample(), theirs_back.raw)[1] == 1)  # type: ignore[func-returns-value]
            owners = reader.claims()
            assert [len(owner.outputs) for owner in owners] == [1, 1]
            assert {owner.outputs[0].number for owner in owners} == {mine.number, theirs.number}
            assert all(owner.pid == os.getpid() and not owner.me for owner in owners)
            assert sum(owner.me for owner in first.claims()) == 1
            free = channel(second, 3)[0]
            with pytest.raises(OwnedError, match=r"0x7010:01 of slave 3 .* belongs to"):
                second.claim([free, mine.path], lease=0.5)
            assert second.output(free).owner is None  # all of them or nothing
        assert reader.claims() == []


def test_several_entries_are_claimed_and_released(troll: Daemon) -> None:
    with troll.client() as bus:
        entries = [channel(bus, n)[0] for n in (0, 2)]
        claim = bus.claim(entries, lease=0.5)
        assert [signal for owner in bus.claims() for signal in owner.outputs] == entries
        bus.release(entries[0])
        assert [bus.output(entry).owned for entry in entries] == [False, True]
        claim.release()
        assert bus.claims() == []
        bus.claim(DRIVE, lease=0.5)
        bus.release(DRIVE)
        bus.claim(EL2008, lease=0.5)
        bus.release()
        come(bus, lambda: bus.claims() == [])
        with pytest.raises(StateError, match="must be claimed"):
            entries[0].raw = 1


def test_who_does_not_sample_loses_the_outputs(troll: Daemon) -> None:
    with troll.client() as bus:
        output, level = channel(bus, 0)
        with bus.claim(EL2008, lease=0.05):
            output.raw = 1
            bus.commit()
            time.sleep(0.3)
            with pytest.raises(LeaseError, match="claim them again"):
                bus.commit()
            bus.claim(EL2008, lease=0.5)
            output.raw = 1
            bus.commit()
            come(bus, lambda: level.raw == 1)


def test_values_are_checked_before_they_go_out(troll: Daemon) -> None:
    with troll.client() as bus, bus.claim(DRIVE, lease=0.5):
        torque = bus.signal(DRIVE, 0x6071)
        for wrong in (1 << 15, (1 << 64) - 1, -(1 << 63), 1 << 70, 0.5, float("nan")):
            with pytest.raises(UsageError, match=r"out of range for 0x6071:00"):
                torque.raw = wrong
        torque.raw = -5.0
        torque.value = 3
        torque.value = 0.0
        bus.commit()


def test_waiting(troll: Daemon) -> None:
    with troll.client() as bus:
        bus.sample()
        before = bus.domain().cycle
        bus.wait(20)
        bus.sample()
        assert bus.domain().cycle >= before + 20
        bus.wait_domain(0, 5)
        assert bus.cycle >= before + 25
        with pytest.raises(NoAnswerError, match=r"cycle that was waited for .* within 0.25 s"):
            bus.wait(1 << 30, timeout=0.25)
        with pytest.raises(NoAnswerError, match="exchange"):
            bus.wait_domain(0, 1 << 30, timeout=0)
        with pytest.raises(UsageError, match="no domain 9"):
            bus.wait_domain(9)
        with pytest.raises(UsageError, match="-1 is nothing to wait for"):
            bus.wait(-1)
        with pytest.raises(UsageError, match="-1 s is no time to wait"):
            bus.wait(timeout=-1)


def test_objects_are_read_and_written(troll: Daemon) -> None:
    with troll.client() as bus:
        assert bus.sdo_read(DRIVE, 0x1018, 1) == b"\x9a\0\0\0"
        mode = bus.sdo_read(DRIVE, 0x6060)
        bus.sdo_write(DRIVE, 0x6060, 0, b"\x03")
        assert bus.sdo_read(DRIVE, 0x6060) == b"\x03"
        bus.sdo_write(DRIVE, 0x6060, 0, mode)
        with pytest.raises(SdoAbortError) as refused:
            bus.sdo_read(DRIVE, 0x7777)
        assert refused.value.code == 0x06020000
        request = bus.sdo_upload(DRIVE, 0x1018, 1)
        while (answer := request.poll()) is None:
            bus.wait()
        assert answer == request.poll() == request.result() == b"\x9a\0\0\0"


def test_requests_that_nobody_asks_for_take_no_place(troll: Daemon) -> None:
    with troll.client() as bus:
        for _ in range(20):
            bus.sdo_upload(DRIVE, 0x1018, 1)
        kept = [bus.sdo_upload(DRIVE, 0x1018, 1) for _ in range(4)]
        with pytest.raises(StateError, match="4 requests are running already"):
            bus.sdo_upload(DRIVE, 0x1018, 1)
        assert [request.result() for request in kept] == 4 * [b"\x9a\0\0\0"]
        with pytest.raises(NoAnswerError, match="answer that was waited for"):
            bus.sdo_read(DRIVE, 0x1018, 1, timeout=0)
        assert bus.sdo_read(DRIVE, 0x1018, 1) == b"\x9a\0\0\0"


def test_a_request_does_not_take_the_answer_of_another(troll: Daemon) -> None:
    """When all requests have ended with the claims, their handles lead nowhere."""
    with troll.client() as bus:
        bus.claim(EL2008, lease=0.05)
        old = bus.sdo_upload(DRIVE, 0x1018, 2)
        time.sleep(0.3)
        bus.claim(EL2008, lease=0.5)
        new = bus.sdo_upload(DRIVE, 0x1018, 1)
        with pytest.raises(UsageError, match="has ended with the claims"):
            old.poll()
        assert new.result() == b"\x9a\0\0\0"


def test_a_program_goes_on_after_a_restart(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll")
    with daemon.client() as bus:
        output, level = channel(bus, 0)
        bus.claim(EL2008, lease=0.5)
        output.raw = 1
        bus.commit()
        come(bus, lambda: level.raw == 1)
        before = bus.instance
        daemon.kill_all()
        with pytest.raises(UnreachableError, match="has ended"):
            while True:
                bus.wait()
        assert level.raw == 1  # the last values stay
        with pytest.raises(UnreachableError):
            bus.sample()
        assert level.validity is Validity.STALE
        for write in (lambda: setattr(output, "raw", 1), bus.commit):
            with pytest.raises(LeaseError, match="the daemon has ended"):
                write()
        with pytest.raises(UnreachableError):
            bus.wait(timeout=0.3)
        daemon = start_daemon("troll", "--bus", daemon.bus)
        bus.wait(timeout=10)
        bus.sample()
        assert bus.instance != before
        assert level.raw == 0
        with pytest.raises(LeaseError, match="claim"):
            output.raw = 1
        with bus.claim(EL2008, lease=0.5):
            output.raw = 1
            bus.commit()
            come(bus, lambda: level.raw == 1)
        assert daemon.stop() == 0
        with pytest.raises(UnreachableError, match="was stopped"):
            bus.sample()
        assert bus.claims() == []


def test_claims_end_quietly_with_the_daemon(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll")
    with daemon.client() as bus, pytest.raises(UnreachableError), bus.claim(EL2008, lease=0.5):
        daemon.kill_all()
        while True:
            bus.wait()
