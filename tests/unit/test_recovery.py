"""Which slaves are brought back to OP, how and when; and who is who on the wire."""

from typing import Any

import pytest

from conftest import names
from ecatd.config import SlaveConfig
from ecatd.description.bus import Slave
from ecatd.etg.al import AlState
from ecatd.master.al_states import SlaveState
from ecatd.server.start.matching import Sought, branch_ends, match
from ecatd.server.watch.recovery import QUICK_TRIES, Condition, Failure, Plan, Recovery

ERROR = 0x10
SAFEOP_ERROR = AlState.SAFEOP | ERROR
OUTSIDE = (0x0018, 0x0019, 0x001A, 0x001B, 0x002C, 0x002D, 0x0032, 0x0033, 0x0034, 0x0035)
OWN = (0x0011, 0x0016, 0x001D, 0x001E, 0x0024, 0x0030, 0x0036, 0x0050, 0x1234, 0x8001)


class Watch:
    """A recovery of one slave, and the time."""

    def __init__(self, mode: str = "all") -> None:
        self.recovery = Recovery(1, mode, retry_s=10.0)
        self.now = 100.0
        self.see(AlState.OP)

    def see(self, state: int, code: int = 0, strangers: int = 0, **options: bool) -> Plan:
        states = [SlaveState(0, state, code)]
        return self.recovery.look(states, strangers, self.now, **options)

    def during(
        self, seconds: float, state: int, code: int = 0, strangers: int = 0
    ) -> list[tuple[float, str]]:
        """What is done while a slave stays as it is; each try fails at once."""
        begin, done = self.now, []
        while self.now < begin + seconds:
            plan = self.see(state, code, strangers)
            for kind in ("ask", "set_up", "slow"):
                if getattr(plan, kind):
                    done.append((round(self.now - begin, 1), kind))
            if plan.ask or plan.set_up:
                self.recovery.done(0, Failure("it does not"))
            self.now += 0.25
        return done

    def condition(self) -> Condition:
        return self.recovery.condition(0)[0]


@pytest.mark.parametrize("code", OUTSIDE)
def test_a_slave_that_lacked_something_is_asked_soon_and_then_slowly(code: int) -> None:
    watch = Watch()
    done = watch.during(60, SAFEOP_ERROR, code)
    assert done[0] == (0, "ask")
    tries = [time for time, kind in done if kind != "slow"]
    assert tries[1] == 0.5
    assert tries[2] == 2.5
    assert tries[3:] == [12.5, 22.5, 32.5, 42.5, 52.5]
    assert [kind for _, kind in done].count("slow") == 1
    assert watch.condition() == Condition.WAITING


def test_r08_the_watchdog_is_asked_twice_and_then_set_up() -> None:
    kinds = [kind for _, kind in Watch().during(11, SAFEOP_ERROR, 0x001B) if kind != "slow"]
    assert kinds == ["ask", "ask", "set_up"]


def test_sync_signals_begin_anew_where_asking_is_no_help() -> None:
    kinds = [kind for _, kind in Watch().during(1, SAFEOP_ERROR, 0x001A)]
    assert kinds == ["ask", "set_up"]


def test_the_acknowledged_state_goes_on_where_it_was() -> None:
    watch = Watch()
    assert watch.see(SAFEOP_ERROR, 0x001B).ask == [0]
    watch.recovery.done(0, None)
    assert not watch.see(AlState.SAFEOP).ask  # not at once
    watch.now += 1
    assert watch.see(AlState.SAFEOP).ask == [0]


@pytest.mark.parametrize("code", OWN)
def test_r08_a_reason_of_its_own_is_told_once_and_not_touched(code: int) -> None:
    watch = Watch()
    plan = watch.see(SAFEOP_ERROR, code)
    assert not plan.ask
    assert not plan.set_up
    assert f"0x{code:04X}" in plan.refused[0]
    assert "ecatctl state 0 OP" in plan.refused[0]
    assert not watch.see(SAFEOP_ERROR, code).refused
    assert watch.during(60, SAFEOP_ERROR, code) == []
    assert watch.condition() == Condition.REFUSED


def test_switching_off_and_on_ends_a_refusal() -> None:
    watch = Watch()
    watch.see(SAFEOP_ERROR, 0x001E)
    watch.see(AlState.NONE)
    assert watch.see(AlState.NONE, strangers=1).set_up == [0]


def test_a_slave_that_came_back_waits_for_nothing_before_it_was_looked_at() -> None:
    watch = Watch()
    for ask in (lambda: watch.recovery.want([0], AlState.OP), lambda: None):
        assert watch.see(SAFEOP_ERROR, 0x001B).ask == [0]  # asked by itself, and by hand
        assert watch.condition() == Condition.RECOVERING
        ask()
        watch.recovery.done(0, None)
        assert watch.condition() == Condition.FINE
        assert watch.see(AlState.OP).recovered
    watch.see(SAFEOP_ERROR, 0x001B)  # but if it falls again at once
    assert watch.condition() == Condition.WAITING


def test_asking_by_hand_ends_a_refusal() -> None:
    watch = Watch()
    watch.see(SAFEOP_ERROR, 0x001E)
    watch.recovery.want([0], AlState.OP)
    assert not watch.see(SAFEOP_ERROR, 0x001B).ask  # somebody is at work
    watch.recovery.done(0, None)
    assert watch.see(SAFEOP_ERROR, 0x001B).ask == [0]


@pytest.mark.parametrize("wanted", [AlState.INIT, AlState.PREOP, AlState.SAFEOP])
def test_a_state_that_somebody_wants_is_respected(wanted: AlState) -> None:
    watch = Watch()
    watch.recovery.want([0], wanted)
    watch.recovery.done(0, None)
    assert watch.during(60, wanted) == []
    assert watch.during(60, SAFEOP_ERROR, 0x001B) == []
    assert watch.during(60, AlState.NONE, strangers=1) == []
    assert watch.condition() == Condition.FINE


def test_a_missing_slave_is_looked_for_when_somebody_without_address_is_there() -> None:
    watch = Watch()
    assert watch.during(30, AlState.NONE) == []
    assert watch.condition() == Condition.MISSING
    assert watch.see(AlState.NONE, strangers=1).set_up == [0]
    assert watch.condition() == Condition.RECOVERING
    assert watch.recovery.done(0, Failure("another device", Condition.EXCHANGED))
    assert watch.condition() == Condition.EXCHANGED
    assert watch.see(AlState.NONE, strangers=2).set_up == [0]
    assert watch.condition() == Condition.EXCHANGED  # while it is looked at again, too
    watch.recovery.done(0, Failure("another device", Condition.EXCHANGED))
    tries = [kind for _, kind in watch.during(40, AlState.NONE, strangers=1) if kind != "slow"]
    assert 4 <= tries.count("set_up") == len(tries) <= 6


def test_whoever_comes_or_goes_is_looked_at_at_once() -> None:
    watch = Watch()
    watch.during(60, AlState.NONE, strangers=1)
    assert not watch.see(AlState.NONE, strangers=1).set_up
    assert watch.see(AlState.NONE, strangers=2).set_up == [0]


def test_whoever_comes_while_somebody_is_at_work_is_looked_at_afterwards() -> None:
    watch = Watch()
    assert watch.see(AlState.NONE, strangers=1).set_up == [0]
    watch.see(AlState.NONE, strangers=2)
    watch.recovery.done(0, Failure("", Condition.MISSING))
    assert watch.see(AlState.NONE, strangers=2).set_up == [0]
    watch.recovery.done(0, Failure("", Condition.MISSING))
    assert watch.see(AlState.NONE, strangers=2).set_up == []


def test_a_try_that_was_too_early_does_not_count() -> None:
    watch = Watch()
    for _ in range(5 * QUICK_TRIES):
        assert watch.see(AlState.NONE, strangers=1).set_up == [0]
        assert not watch.recovery.done(0, Failure("the wire changes", early=True))
    assert watch.condition() == Condition.WAITING
    assert watch.recovery.condition(0)[1] == "the wire changes"


def test_who_comes_while_others_get_their_addresses_is_looked_at() -> None:
    recovery = Recovery(3)
    nobody = SlaveState(0, AlState.NONE, 0)
    states = [nobody, *(SlaveState(n, AlState.NONE, 0) for n in (1, 2))]
    assert recovery.look(states, 1, 1.0).set_up == [0, 1, 2]
    for position in (0, 1):
        recovery.done(position, None)
        states[position] = SlaveState(position, AlState.OP, 0)
    recovery.done(2, Failure("", Condition.MISSING))
    assert recovery.look(states, 1, 1.1).set_up == [2]  # as many strangers as before


def test_each_time_that_a_slave_comes_is_a_new_one() -> None:
    watch = Watch()
    for _ in range(2 * QUICK_TRIES):
        watch.see(AlState.NONE)
        watch.now += 0.2
        assert watch.see(AlState.NONE, strangers=1).set_up == [0]
        watch.see(AlState.NONE, strangers=1)
        watch.recovery.done(0, Failure("", Condition.MISSING))  # it was too early
        watch.now += 0.5
        assert watch.see(AlState.NONE, strangers=1).set_up == [0]
        watch.recovery.done(0, None)
        watch.see(AlState.OP)
        watch.now += 0.2


def test_the_same_failure_is_told_once() -> None:
    recovery = Watch().recovery
    recovery.look([SlaveState(0, SAFEOP_ERROR, 0x001B)], 0, 1.0)
    assert recovery.done(0, Failure("a"))
    assert not recovery.done(0, Failure("a"))
    assert recovery.done(0, Failure("b"))


def test_a_device_in_the_place_of_a_slave_is_known_until_the_slave_is_back() -> None:
    watch = Watch()
    watch.see(AlState.NONE, strangers=1)
    watch.recovery.done(0, Failure("another device", Condition.EXCHANGED, (2, 10)))
    assert watch.recovery.left_alone() == {0: (2, 10)}
    watch.recovery.done(0, Failure("two are like it", Condition.MISSING))
    assert watch.recovery.left_alone() == {0: None}
    watch.see(AlState.OP)
    assert watch.recovery.left_alone() == {}


@pytest.mark.parametrize("state", [AlState.INIT, AlState.PREOP])
def test_a_slave_that_began_anew_is_set_up(state: AlState) -> None:
    watch = Watch()
    assert watch.during(2.5, state) == []  # another master might be at work
    assert [kind for _, kind in watch.during(1, state)][:1] == ["set_up"]


def test_firmware_on_its_way_is_not_disturbed() -> None:
    assert Watch().during(60, AlState.BOOT) == []


def test_another_master_is_not_fought() -> None:
    watch = Watch()
    for _ in range(100):
        plan = watch.see(SAFEOP_ERROR, 0x001B, foreign=True)
        assert not plan.ask
        assert not plan.set_up
        watch.now += 1
    plan = watch.see(SAFEOP_ERROR, 0x001B)
    assert plan.set_up == [0]  # its settings may be those of the other one


def test_how_long_it_took_is_told_once() -> None:
    watch = Watch()
    assert watch.see(SAFEOP_ERROR, 0x001B).fallen == [0]
    watch.recovery.done(0, None)
    watch.now += 1.5
    assert watch.see(AlState.OP).recovered == {0: 1.5}
    assert watch.see(AlState.OP).recovered == {}


def test_r08_one_that_falls_again_and_again_is_asked_slowly() -> None:
    watch = Watch()
    tries = []
    for _ in range(240):
        plan = watch.see(SAFEOP_ERROR, 0x001B)
        if plan.ask or plan.set_up:
            tries.append(watch.now)
            watch.recovery.done(0, None)
            watch.see(AlState.OP)
        watch.now += 0.25
    assert len(tries) == QUICK_TRIES + 5


def test_one_that_was_steady_in_op_has_its_quick_tries_again() -> None:
    watch = Watch()
    for _ in range(5):
        assert watch.see(SAFEOP_ERROR, 0x001B).ask == [0]
        watch.recovery.done(0, None)
        for _ in range(12):
            watch.see(AlState.OP)
            watch.now += 1


def test_only_the_watchdog_where_only_that_is_wanted() -> None:
    watch = Watch("watchdog")
    assert watch.during(20, SAFEOP_ERROR, 0x001A) == []
    assert watch.during(20, AlState.NONE, strangers=1) == []
    assert watch.during(20, AlState.INIT) == []
    done = Watch("watchdog").during(20, SAFEOP_ERROR, 0x001B)
    assert {kind for _, kind in done} == {"ask", "slow"}


def test_nothing_where_nothing_is_wanted() -> None:
    watch = Watch("none")
    assert watch.during(20, SAFEOP_ERROR, 0x001B) == []
    assert watch.during(20, AlState.NONE, strangers=1) == []
    assert watch.condition() == Condition.MISSING


Identity = tuple[int, int, int]
A, B, C = (2, 0xA, 1), (2, 0xB, 1), (2, 0xC, 1)


def places(
    scan: list[Identity], wire: list[int | Identity], ends: list[int] | None = None
) -> tuple[dict[int, int], set[int], set[int]]:
    """Who is found where, exchanged, unclear; a number on the wire is a slave with its address."""
    slaves = [Slave(i, f"S{i}", *item, address=0x1001 + i) for i, item in enumerate(scan)]
    found = match(
        [Sought.of(slave, SlaveConfig(slave.position)) for slave in slaves],
        [0x1001 + item if isinstance(item, int) else 0 for item in wire],
        {n: Slave(n, "", *item) for n, item in enumerate(wire) if not isinstance(item, int)},
        ends or [len(scan)] * len(scan),
    )
    return found.places, set(found.exchanged), set(found.unclear)


@pytest.mark.parametrize(
    ("scan", "wire", "expected"),
    [
        ([A, B, C], [0, B, 2], ({1: 1}, set(), set())),
        ([A, B, C], [A, B, C], ({0: 0, 1: 1, 2: 2}, set(), set())),
        ([A, B, C], [0, C, B], ({}, {1, 2}, set())),  # another order
        ([A, B, C], [0, C, 2], ({}, {1}, set())),  # another device
        ([A, B, C], [0, (2, 0xB, 9), 2], ({}, {1}, set())),  # another revision
        ([A, B, C], [0, C, C], ({2: 2}, {1}, set())),  # the right one comes back all the same
        ([A, A, A, A], [0, A, A], ({1: 1, 2: 2}, set(), set())),  # the last one is still missing
        ([A, B, C], [0, 1, 2, A], ({}, set(), set())),  # a new one
        ([A, B, C], [0, B, B, 2], ({}, set(), {1})),  # two in the place of one
        ([A, B, C], [1, 0, C], ({}, set(), {2})),  # plugged in otherwise
        ([A, B, C], [0, 0, C], ({}, set(), {1, 2})),  # an address twice
        ([A, B], [], ({}, set(), set())),
    ],
)
def test_slaves_are_found_by_place_and_identity(
    scan: list[Identity],
    wire: list[int | Identity],
    expected: tuple[dict[int, int], set[int], set[int]],
) -> None:
    assert places(scan, wire) == expected


KIND = {"vendor": 2, "product": 0xA}
SPARE = {"revision": 7, "serial": 12, "alias": 3}


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({}, "revision 0x00000007 | 0x00000001 | restart"),  # it is not the one of the start
        ({"alias": 3}, "revision 0x00000007 | 0x00000001"),
        (KIND, ""),
        ({**KIND, "revision_min": 7}, ""),
        ({**KIND, "revision_min": 8}, "revision 0x00000007 | 0x00000008 or newer | [[slave]]"),
        ({**KIND, "revision": 1}, "revision 0x00000007 | 0x00000001 | [[slave]]"),
        ({**KIND, "serial": 12}, ""),
        ({**KIND, "serial": 13}, "serial number 12 | 13 | [[slave]]"),
        ({**KIND, "alias": 3}, ""),
        ({**KIND, "alias": 4}, "station alias 3 | 4 | alias"),
        ({"vendor": 2, "product": 0xB}, "product 0x0000000A | product 0x0000000B | [[slave]]"),
    ],
)
def test_the_table_of_a_slave_says_who_may_take_its_place(table: dict[str, Any], said: str) -> None:
    sought = Sought.of(Slave(1, "EL1", *A, serial=11), SlaveConfig(1, **table))
    spare = Slave(4, "", 2, 0xA, **SPARE)
    assert sought.fits(spare) == (not said)
    exchanged = sought.why_not(spare)
    assert (exchanged is None) == (not said)
    if exchanged:
        assert exchanged.device == (2, 0xA)
        names(exchanged.text, "left alone", *said.split(" | "))


@pytest.mark.parametrize(
    ("scan", "wire", "expected"),
    [
        ([A, B, C, A], [0, C, 3], ({2: 1}, set(), set())),  # there is only one way
        ([A, B, B, A], [0, B, 3], ({}, set(), {1, 2})),  # which of both?
        ([A, B, C, A], [0, A, 3], ({}, set(), {1, 2})),
        ([A, B, C, B], [0, B, C], ({1: 1, 2: 2}, set(), set())),
        ([A, B], [0, C], ({}, {1}, set())),
        ([A] * 199, [A] * 100, ({}, set(), set(range(199)))),
    ],
)
def test_on_a_ring_those_behind_may_be_there_first(
    scan: list[Identity],
    wire: list[int | Identity],
    expected: tuple[dict[int, int], set[int], set[int]],
) -> None:
    ends = branch_ends([2] * len(scan), ring=True)
    assert places(scan, wire, ends) == expected


TREE = [A, B, A, B, A, C, A]  # 0 has 1 to 5 behind it: 1 alone, 2 with 3, 4 with 5; then 6
LINKS = [5, 1, 2, 1, 2, 1, 1]


@pytest.mark.parametrize(
    ("wire", "expected"),
    [
        ([0, 1, A, C, 6], ({4: 2, 5: 3}, set(), set())),  # not 2 with 5: 4 would be missing
        ([0, 1, A, B, 6], ({2: 2, 3: 3}, set(), set())),
        ([0, 1, A, 6], ({}, set(), {2, 3, 4, 5})),  # a coupler whose terminal is still away
        ([0, 1, A, A, C, 6], ({2: 2, 4: 3, 5: 4}, set(), set())),
        ([0, B, A, B, 6], ({1: 1, 2: 2, 3: 3}, set(), set())),
        ([0, 1, 2, 3, 4, A, 6], ({}, {5}, set())),
        ([A, A], ({}, set(), {0, 1, 2, 3, 4, 5, 6})),
        ([A, B, A, B, A, C, A], ({i: i for i in range(7)}, set(), set())),
    ],
)
def test_behind_a_junction_whole_branches_are_missing(
    wire: list[int | Identity], expected: tuple[dict[int, int], set[int], set[int]]
) -> None:
    assert places(TREE, wire, branch_ends(LINKS, ring=False)) == expected


@pytest.mark.parametrize(
    ("links", "ends"),
    [
        ([2, 2, 1], [3, 3, 3]),
        (LINKS, [7, 2, 4, 4, 6, 6, 7]),
        ([1, 2, 1], [1, 2, 3]),  # a link was lost meanwhile
        ([], []),
    ],
)
def test_who_is_reached_through_whom(links: list[int], ends: list[int]) -> None:
    assert branch_ends(links, ring=False) == ends
