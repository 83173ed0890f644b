"""The Python client on a real bus: entries, claims, requests, restarts of the daemon."""

import asyncio
import os
from collections.abc import Callable

import pytest

from conftest import Daemon, names, naming, wait_for, wait_for_end
from ecatd import LeaseError, OwnedError, SdoAbortError, UnreachableError
from ecatd.base.errors import NoAnswerError, StateError, UsageError
from ecatd.client import Client, Outputs, Reason, Signal, Validity

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


def lapse(bus: Client) -> None:
    """Waits, which alone is no sign of life, until the outputs are lost."""
    while bus.owners():
        bus.wait()


def test_a_value_goes_out_and_comes_back(troll: Daemon) -> None:
    with troll.client() as bus:
        output, level = channel(bus, 0)
        with bus.claim(EL2008, lease=30) as claim:
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
        with pytest.raises(StateError, match=naming("0x7000:01", "claimed")):
            output.raw = 1
        with pytest.raises(UsageError, match=naming("input")):
            level.raw = 1


def test_entries_of_one_slave_belong_to_two_clients(troll: Daemon) -> None:
    with troll.client() as first, troll.client() as second, troll.client() as reader:
        mine, mine_back = channel(first, 1)
        theirs, theirs_back = channel(second, 2)
        with first.claim(mine, lease=30), second.claim(f"{EL2008}/0x7020:01", lease=30):
            mine.raw = theirs.raw = 1
            first.commit()
            second.commit()
            come(first, lambda: (second.sample(), mine_back.raw)[1] == 1)  # type: ignore[func-returns-value]
            come(second, lambda: (first.sample(), theirs_back.raw)[1] == 1)  # type: ignore[func-returns-value]
            owners = reader.owners()
            assert [len(owner.outputs) for owner in owners] == [1, 1]
            assert {owner.outputs[0].number for owner in owners} == {mine.number, theirs.number}
            assert all(owner.pid == os.getpid() and not owner.me for owner in owners)
            assert sum(owner.me for owner in first.owners()) == 1
            free = channel(second, 3)[0]
            with pytest.raises(OwnedError, match=naming("0x7010:01", "slave 3", "belongs to")):
                second.claim([free, mine.path], lease=30)
            assert second.output(free).owner is None  # all of them or nothing
        assert reader.owners() == []


def test_several_entries_are_claimed_and_released(troll: Daemon) -> None:
    with troll.client() as bus:
        entries = [channel(bus, n)[0] for n in (0, 2)]
        claim = bus.claim(entries, lease=30)
        assert [signal for owner in bus.owners() for signal in owner.outputs] == entries
        assert len({bus.output(entry).since_cycle for entry in entries}) == 1  # all at once
        claim.release()
        assert bus.owners() == []
        whole = bus.claim(EL2008, lease=30)
        assert [signal for owner in bus.owners() for signal in owner.outputs] == list(whole.outputs)
        whole.release()
        assert bus.owners() == []
        with pytest.raises(StateError, match=naming("0x7000:01", "claimed")):
            entries[0].raw = 1


def test_what_another_claim_holds_is_not_given_back(troll: Daemon) -> None:
    with troll.client() as bus, troll.client() as other:
        mine, level = channel(bus, 0)
        theirs = channel(bus, 1)[0]
        of_other = other.claim(channel(other, 1)[0], lease=30)
        with bus.claim(mine, lease=30):
            mine.raw = 1
            bus.commit()
            come(bus, lambda: level.raw == 1)
            since = bus.output(mine).since_cycle
            for wanted in ([mine, theirs], EL2008):
                with pytest.raises(OwnedError, match=naming("belongs to", "0x7010:01", "slave 3")):
                    bus.claim(wanted, lease=30)
            with (
                bus.claim([mine, channel(bus, 2)[0]], lease=30) as inner,
                bus.claim(mine, lease=30),
            ):
                assert all(bus.output(output).owned for output in inner.outputs)
            assert [bus.output(output).owned for output in inner.outputs] == [True, False]
            of_other.release()
            come(bus, lambda: bus.output(theirs).owner is None)
            with bus.claim(EL2008, lease=30) as whole:
                assert all(bus.output(output).owned for output in whole.outputs)
            assert bus.output(mine).since_cycle == since  # active all the time
            assert bus.output(mine).state is Outputs.ACTIVE
            assert [output for output in whole.outputs if bus.output(output).owned] == [mine]
            assert len({bus.output(output).since_cycle for output in whole.outputs[1:]}) == 1
        assert bus.owners() == []
        inner.release()  # once more is no harm


def test_a_claim_after_a_lapse_holds_what_an_older_one_has_lost(troll: Daemon) -> None:
    with troll.client() as bus:
        output = channel(bus, 0)[0]
        old = bus.claim(output, lease=2)
        lapse(bus)
        with pytest.raises(LeaseError):
            bus.commit()
        with bus.claim(output, lease=30):
            old.release()
            assert bus.output(output).owned
        assert not bus.output(output).owned
        with pytest.raises(UsageError, match=naming("empty")):
            bus.claim([])
        with pytest.raises(TypeError):  # a second output is no lease
            bus.claim(output, channel(bus, 1)[0])  # type: ignore[misc]


def test_who_does_not_sample_loses_the_outputs(troll: Daemon) -> None:
    with troll.client() as bus:
        output, level = channel(bus, 0)
        with bus.claim(EL2008, lease=2):
            output.raw = 1
            bus.commit()
            lapse(bus)
            with pytest.raises(LeaseError, match="claim them again"):
                bus.commit()
            for value in (1, True):
                with pytest.raises(LeaseError, match="claim them again"):
                    output.raw = value
            bus.claim(EL2008, lease=30)
            output.raw = 1
            bus.commit()
            come(bus, lambda: level.raw == 1)


def test_values_are_checked_before_they_go_out(troll: Daemon) -> None:
    with troll.client() as bus, bus.claim(DRIVE, lease=30):
        torque = bus.signal(DRIVE, 0x6071)
        for wrong in (1 << 15, (1 << 64) - 1, -(1 << 63), 1 << 70, 32767.5, float("nan")):
            with pytest.raises(UsageError, match=naming("out of range", "0x6071:00")):
                torque.raw = wrong
        torque.raw = -5.0
        torque.value = 3
        torque.value = 0.0
        bus.commit()


def test_what_is_out_of_range_is_said_in_the_unit_of_the_program(
    start_daemon: Callable[..., Daemon],
) -> None:
    scaled = (
        '[[signal]]\nslave = 0\nentry = "0x60FF:00"\nscale = -0.1\noffset = 5.0\nunit = "rpm"\n'
    )
    daemon = start_daemon("troll", config=scaled)
    with daemon.client() as bus, bus.claim(DRIVE, lease=30):
        target = bus.signal(DRIVE, 0x60FF)
        assert target.bit_length == 32
        said = naming("nan rpm", "0x60FF:00", "-214748359.7", "214748369.8 rpm")
        with pytest.raises(UsageError, match=said):
            target.value = float("nan")
        with pytest.raises(UsageError, match=naming(3000000000, "0x60FF:00", 2147483647)):
            target.raw = 3e9
        target.value = 3e8  # an analog quantity is held at its limit
        torque = bus.signal(DRIVE, 0x6071)
        with pytest.raises(UsageError, match=naming(40000, "whole numbers", -32768, 32767)):
            torque.value = 40000


WRONG = [
    (lambda bus: Client(5), "bus | 5"),
    (lambda bus: Client(f"{bus.name}\0x"), "bus | text"),
    (lambda bus: bus.claim(DRIVE, lease="x"), "lease | seconds | 'x'"),
    (lambda bus: bus.claim(DRIVE, lease=float("nan")), "lease | seconds | nan"),
    (lambda bus: bus.claim(1 << 32), "what | 4294967296"),
    (lambda bus: bus.claim(1.5), "what | 1.5"),
    (lambda bus: bus.claim(["3/0x7000:01", 3]), "what | 3"),
    (lambda bus: bus.signal(None), "what | None"),
    (lambda bus: bus.signal(1 << 32), "what | 4294967296"),
    (lambda bus: bus.signal(DRIVE, 0x6041, 256), "subindex | 0 to 255 | 256"),
    (lambda bus: bus.signal(DRIVE, 0x16041), "index | 0 to 65535"),
    (lambda bus: bus.signal("0", 0x6041), "index | name"),
    (lambda bus: bus.signal("0/0x6041:00\0"), "what | text"),
    (lambda bus: bus.signal("0/0x6041:00", direction="in"), "direction | 'in'"),
    (lambda bus: bus.signals("0"), "slave | '0'"),
    (lambda bus: bus.group("0/0x6041:00"), "signals | several | '0/0x6041:00'"),
    (lambda bus: bus.group(7), "signals | several | 7"),
    (lambda bus: bus.group([b"0/0x6041:00"]), "signals | Signal"),
    (lambda bus: bus.summarize(["0/0x6041:00"], "2"), "cycles | '2'"),
    (lambda bus: bus.summarize(["0/0x6041:00"], -1), "cycles | -1"),
    (lambda bus: bus.summarize(["0/0x6041:00"], 2, timeout=None), "timeout | None"),
    (lambda bus: bus.sample("0"), "domain | '0'"),
    (lambda bus: bus.sample(1 << 32), "domain | 4294967296"),
    (lambda bus: bus.wait("1"), "cycles | '1'"),
    (lambda bus: bus.wait(timeout="1"), "timeout | '1'"),
    (lambda bus: bus.wait(domain=0.0), "domain | 0.0"),
    (lambda bus: bus.domain(None), "number | None"),
    (lambda bus: bus.domain_array("0"), "number | '0'"),
    (lambda bus: bus.output(3), "what | 3"),
    (lambda bus: bus.expect(0, 1 << 32, 2), "vendor | 4294967296"),
    (lambda bus: bus.expect(0, "2", 2), "vendor | '2'"),
    (lambda bus: bus.sdo_upload("0", 0x1018), "slave | '0'"),
    (lambda bus: bus.sdo_upload(DRIVE, 0x1018, 0x101), "subindex | 257"),
    (lambda bus: bus.sdo_download(DRIVE, 0x6060, 0, 8), "data | bytes | 8"),
    (lambda bus: bus.sdo_upload(DRIVE, 0x1018).result("1"), "timeout | '1'"),
    (lambda bus: bus.request_state(DRIVE, "OP"), "state | 'OP'"),
    (lambda bus: asyncio.run(bus.next_cycle("1")), "cycles | '1'"),
    (lambda bus: asyncio.run(bus.next_cycle(timeout="1")), "timeout | '1'"),
]


def test_a_wrong_argument_is_named(troll: Daemon) -> None:
    with troll.client() as bus, troll.client() as other:
        for call, said in WRONG:
            with pytest.raises(UsageError, match=naming(*said.split(" | "))):
                call(bus)  # type: ignore[no-untyped-call]
        with pytest.raises(UsageError, match=naming("what", "another client")):
            bus.claim(other.signal("3/0x7000:01"))
        assert bus.owners() == []


def test_waiting(troll: Daemon) -> None:
    with troll.client() as bus:
        bus.sample()
        before = bus.domain().cycle
        bus.wait(20)
        bus.sample()
        assert bus.domain().cycle >= before + 20
        bus.wait(5, domain=0)
        assert bus.cycle >= before + 25
        with pytest.raises(NoAnswerError, match=naming("cycle", "0.25 s")):
            bus.wait(1 << 30, timeout=0.25)
        with pytest.raises(NoAnswerError, match="exchange"):
            bus.wait(1 << 30, timeout=0, domain=0)
        with pytest.raises(UsageError, match=naming("domain 9")):
            bus.wait(domain=9)
        with pytest.raises(UsageError, match=naming("-1", "wait")):
            bus.wait(-1)
        with pytest.raises(UsageError, match=naming("-1 s", "wait")):
            bus.wait(timeout=-1)


def test_objects_are_read_and_written(troll: Daemon) -> None:
    with troll.client() as bus:
        assert bus.sdo_upload(DRIVE, 0x1018, 1).result() == b"\x9a\0\0\0"
        mode = bus.sdo_upload(DRIVE, 0x6060).result()
        bus.sdo_download(DRIVE, 0x6060, 0, b"\x03").result()
        assert bus.sdo_upload(DRIVE, 0x6060).result() == b"\x03"
        bus.sdo_download(DRIVE, 0x6060, 0, mode).result()
        with pytest.raises(SdoAbortError) as refused:
            bus.sdo_upload(DRIVE, 0x7777).result()
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
        with pytest.raises(StateError, match=naming("4 requests")):
            bus.sdo_upload(DRIVE, 0x1018, 1)
        assert [request.result() for request in kept] == 4 * [b"\x9a\0\0\0"]

        def is_too_early() -> bool:
            try:
                bus.sdo_upload(DRIVE, 0x1018, 1).result(0)
            except NoAnswerError as error:
                names(error, "answer")
                return True
            return False  # the answer was there before this program ran again

        wait_for(is_too_early, troll)
        assert bus.sdo_upload(DRIVE, 0x1018, 1).result() == b"\x9a\0\0\0"


def test_requests_of_a_closed_client_end_with_it(troll: Daemon) -> None:
    bus = troll.client()
    unwanted, other = (bus.sdo_upload(DRIVE, 0x1018, 1) for _ in range(2))
    del other
    bus.close()
    with pytest.raises(StateError, match="is closed"):
        bus.sdo_upload(DRIVE, 0x1018, 1)
    with pytest.raises(StateError, match="is closed"):
        unwanted.cancel()
    with pytest.raises(StateError, match="was cancelled"):
        unwanted.poll()


def test_a_request_does_not_take_the_answer_of_another(troll: Daemon) -> None:
    """When all requests have ended with the claims, their handles lead nowhere."""
    with troll.client() as bus:
        bus.claim(EL2008, lease=2)
        old = bus.sdo_upload(DRIVE, 0x1018, 2)
        lapse(bus)
        bus.claim(EL2008, lease=30)
        new = bus.sdo_upload(DRIVE, 0x1018, 1)
        with pytest.raises(UsageError, match=naming("has ended", "claims")):
            old.poll()
        assert new.result() == b"\x9a\0\0\0"


def test_a_program_goes_on_after_a_restart(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll")
    with daemon.client() as bus:
        output, level = channel(bus, 0)
        bus.claim(EL2008, lease=30)
        output.raw = 1
        bus.commit()
        come(bus, lambda: level.raw == 1)
        before = bus.instance
        daemon.kill_all()
        wait_for_end(bus)
        assert level.raw == 1  # the last values stay
        with pytest.raises(UnreachableError):
            bus.sample()
        assert level.validity is Validity.STALE
        for write in (lambda: setattr(output, "raw", 1), bus.commit):
            with pytest.raises(LeaseError, match=naming("daemon", "has ended")):
                write()
        with pytest.raises(UnreachableError):
            bus.wait(timeout=0.3)
        daemon = start_daemon("troll", "--bus", daemon.bus)
        bus.wait()
        bus.sample()
        assert bus.instance != before
        assert level.raw == 0
        with pytest.raises(LeaseError, match="claim"):
            output.raw = 1
        with bus.claim(EL2008, lease=30):
            output.raw = 1
            bus.commit()
            come(bus, lambda: level.raw == 1)
        assert daemon.stop() == 0
        with pytest.raises(UnreachableError, match="was stopped"):
            bus.sample()
        assert bus.owners() == []


def test_claims_end_quietly_with_the_daemon(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("troll")
    with daemon.client() as bus, pytest.raises(UnreachableError), bus.claim(EL2008, lease=30):
        daemon.kill_all()
        while True:
            bus.wait()
