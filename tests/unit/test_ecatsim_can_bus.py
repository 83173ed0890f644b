"""The CAN bus of the simulator: bits, arbitration, errors, bus-off. The test runs its time."""

import pytest
from can_bench import BIT, MBIT, Bus, Keeper
from hypothesis import given
from hypothesis import strategies as st

from ecatd.base.errors import UsageError
from ecatsim.can import CanFrame, CanNode, Filter, NodeState, Stuck, Traffic
from ecatsim.can.bus import wire_bits

IDLE = 11  # bits


@st.composite
def frames(draw):
    extended = draw(st.booleans())
    identifier = draw(st.integers(0, (1 << (29 if extended else 11)) - 1))
    if draw(st.booleans()):
        return CanFrame(identifier, b"", extended, True, draw(st.integers(0, 8)))
    return CanFrame(identifier, draw(st.binary(max_size=8)), extended)


def fields(frame):
    """The bits of a frame up to the data, by the figures of ISO 11898-1."""
    remote = int(frame.remote)
    if frame.extended:
        text = f"0{frame.id >> 18:011b}11{frame.id & 0x3FFFF:018b}{remote}00"
    else:
        text = f"0{frame.id:011b}{remote}00"
    return text + f"{frame.size:04b}" + "".join(f"{byte:08b}" for byte in frame.data)


def remainder(text):
    """The CRC as a division of polynomials."""
    value = int(text, 2) << 15
    for shift in range(value.bit_length() - 16, -1, -1):
        if value >> (shift + 15) & 1:
            value ^= 0xC599 << shift
    return f"{value:015b}"


def unstuffed(bits):
    """Removes stuff bits, which must be there after five equal bits."""
    result, run, last = [], 0, 2
    rest = iter(bits)
    for bit in rest:
        run = run + 1 if bit == last else 1
        result.append(bit)
        last = bit
        if run == 5:
            last, run = next(rest), 1
            assert last != bit
    return result


@given(frame=frames())
def test_bits_of_a_frame(frame):
    bits = wire_bits(frame)
    assert bits[-13:] == [1, 0, 1, *[1] * 10]
    text = fields(frame)
    assert "".join(map(str, unstuffed(bits[:-13]))) == text + remainder(text)


def test_the_check_value_of_the_crc():
    """That of CRC-15/CAN in catalogues of CRCs."""
    assert int(remainder("".join(f"{byte:08b}" for byte in b"123456789")), 2) == 0x059E


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (CanFrame(1), CanFrame(2)),
        (CanFrame(0x123, b"\0"), CanFrame(0x123, remote=True, length=1)),
        (CanFrame(0x123, remote=True), CanFrame(0x123 << 18, extended=True)),
        (CanFrame(0x123 << 18, extended=True), CanFrame(0x124)),
        (CanFrame(5, extended=True), CanFrame(5, extended=True, remote=True)),
    ],
)
def test_the_smaller_identifier_wins(first, second):
    bus = Bus()
    one, other, keeper = (bus.add(node) for node in (CanNode(), CanNode(), Keeper()))
    bus.begin()
    one.send(second)
    other.send(first)
    bus.run_ns(1_000_000)
    found = [(f.id, f.extended, f.remote) for f in keeper.frames]
    assert found == [(f.id, f.extended, f.remote) for f in (first, second)]
    assert one.status.lost_arbitrations == 1
    assert other.status.lost_arbitrations == 0


def test_frames_follow_each_other_without_a_gap():
    bus = Bus()
    sender, keeper = bus.add(CanNode()), bus.add(Keeper())
    bus.begin()
    sent = [CanFrame(7, bytes(n)) for n in range(9)]
    sender.send(*sent)
    begin = bus.now
    bus.run_ns(2_000_000)
    end = begin
    for frame, got in zip(sent, keeper.frames, strict=True):
        bits = len(wire_bits(frame))
        assert got.time_ns == end + (bits - 3) * BIT  # without the intermission
        end += bits * BIT
    assert bus.status().busy_ns == end - begin
    assert bus.status().frames == 9


@given(st.lists(st.integers(1, 3_000_000), min_size=1, max_size=30))
def test_it_does_not_matter_when_somebody_looks(steps):
    def run(pauses):
        bus = Bus()
        source = CanNode(traffic=[Traffic(0x50), Traffic(0x40, rate=700, length=3)])
        bus.add(source)
        bus.add(CanNode(traffic=[Traffic(0x45, rate=900)]))
        keeper = bus.add(Keeper())
        bus.set_noise(0.1, seed=7)
        for pause in pauses:
            bus.run_ns(pause)
        return [(f.id, f.data, f.time_ns) for f in keeper.frames][:200], bus.status()

    assert run(steps) == run([sum(steps)])


# --- acknowledgement and errors ------------------------------------------------------------------


def test_a_lone_node_becomes_passive_and_never_bus_off():
    bus = Bus()
    lone = bus.add(CanNode())
    bus.begin()
    lone.send(CanFrame(1), CanFrame(2))
    bus.run_ns(1_000_000_000)
    status = lone.status
    assert (status.state, status.transmit_errors, status.sent) == (NodeState.PASSIVE, 128, 0)
    assert status.not_acknowledged > 1000
    assert status.transmit_pending == 2
    other = bus.add(Keeper())
    bus.run_ns(1_000_000)
    assert other.ids == [1, 2]
    assert lone.status.transmit_errors == 126
    assert lone.status.state == NodeState.WARNING


def test_a_node_that_only_listens_acknowledges_nothing():
    bus = Bus()
    sender, listener = bus.add(CanNode()), bus.add(Keeper())
    bus.configure(listener.place, MBIT, listens_only=True)
    bus.begin()
    sender.send(CanFrame(1))
    bus.run_ns(1_000_000)
    assert sender.status.sent == 0
    assert listener.ids == []


def test_passive_nodes_let_others_go_first():
    bus = Bus()
    lone = bus.add(CanNode())
    bus.begin()
    lone.send(*(CanFrame(n) for n in range(10)))
    bus.run_ns(50_000_000)  # it is passive now
    other, keeper = bus.add(CanNode()), bus.add(Keeper())
    other.send(*(CanFrame(0x100 + n) for n in range(3)))
    bus.run_ns(3_000_000)
    # Its identifiers are smaller, but it waits for 8 bits after its frame, and the other does not.
    assert keeper.ids[:3] != [0, 1, 2]
    assert sorted(keeper.ids) == [*range(10), 0x100, 0x101, 0x102]


def test_a_bus_without_termination_loses_nothing_but_time():
    bus = Bus()
    load = Traffic(0x100, rate=3000, count=3000)
    sender, checker = bus.add(CanNode(traffic=[load])), bus.add(CanNode(checks=[load]))
    bus.set_noise(0.02)
    bus.run_ns(1_100_000_000)
    assert checker.check_results[0].received == sender.status.sent == 3000
    assert checker.check_results[0].lost == checker.check_results[0].doubled == 0
    assert sender.status.failed == bus.status().error_frames > 30
    assert sender.status.state == NodeState.ACTIVE


def test_much_noise_leads_to_bus_off():
    bus = Bus()
    sender, other = bus.add(CanNode(traffic=[Traffic(1)])), bus.add(Keeper())
    bus.set_noise(1.0)
    bus.run_ns(10_000_000)
    assert sender.status.state in (NodeState.BUS_OFF, NodeState.PASSIVE)
    assert sender.status.bus_offs >= 1
    assert other.status.receive_errors > 0
    assert other.frames == []
    bus.set_noise(0.0)
    bus.run_ns(10_000_000)
    assert sender.status.state == NodeState.ACTIVE


def test_bus_off_takes_32_attempts_and_128_idles():
    bus = Bus()
    sender = bus.add(CanNode())
    bus.add(Keeper())
    bus.begin()
    begin = bus.now
    bus.set_stuck(Stuck.RECESSIVE)
    sender.send(CanFrame(1))
    # Until it is passive, an attempt takes a bit, a flag, a delimiter, and the intermission.
    attempts = 32 * (1 + 6 + 8 + 3) + 16 * 8
    bus.run_ns((attempts - 8) * BIT)
    assert (sender.status.state, sender.status.failed) == (NodeState.BUS_OFF, 32)
    bus.set_stuck(Stuck.NO)
    # Each error frame that it has sent does not count, nor does the time before bus-off.
    bus.run_ns(127 * IDLE * BIT)
    assert sender.status.state == NodeState.BUS_OFF
    bus.run_ns(20 * BIT)
    assert sender.status.state != NodeState.BUS_OFF
    bus.run_ns(100 * BIT)
    assert sender.status.sent == 1
    assert bus.now - begin < 3_000_000


def test_a_node_that_stays_off_waits_for_its_application():
    bus = Bus()
    place = bus.add_place("controller", recovers=False)
    bus.power(place, True)
    keeper = bus.add(Keeper())
    bus.begin()
    bus.force_bus_off(place)
    bus.send(place, [CanFrame(1)])
    bus.run_ns(100_000_000)
    assert bus.node_status(place).state == NodeState.BUS_OFF
    bus.restart(place)
    bus.run_ns(2_000_000)
    assert keeper.ids == [1]


def test_a_wire_that_is_dominant_carries_nothing():
    bus = Bus()
    sender, keeper = bus.add(CanNode()), bus.add(Keeper())
    bus.begin()
    bus.set_stuck(Stuck.DOMINANT)
    sender.send(CanFrame(1))
    bus.run_ns(10_000_000)
    assert (sender.status.sent, sender.status.state) == (0, NodeState.PASSIVE)
    bus.set_stuck(Stuck.NO)
    bus.run_ns(1_000_000)
    assert keeper.ids == [1]


# --- other bit rates -----------------------------------------------------------------------------


def test_a_listener_with_another_bit_rate_disturbs_until_it_is_passive():
    bus = Bus()
    load = Traffic(0x100, rate=1000)
    sender, checker = bus.add(CanNode(traffic=[load])), bus.add(CanNode(checks=[load]))
    wrong = bus.add(Keeper("wrong", 500_000))
    bus.run_ns(100_000_000)
    assert wrong.frames == []
    assert wrong.status.state == NodeState.PASSIVE
    assert 10 <= sender.status.failed <= 20
    found = checker.check_results[0]
    assert found.received >= 98
    assert found.lost == found.doubled == 0


def test_nobody_understands_a_sender_with_another_bit_rate():
    bus = Bus()
    first, second = bus.add(Keeper("first")), bus.add(Keeper("second"))
    wrong = bus.add(CanNode("wrong", 250_000))
    bus.begin()
    wrong.send(CanFrame(1))
    bus.run_ns(20_000_000)
    assert first.frames == second.frames == []
    # All error flags are passive by now, and nobody acknowledges its frame.
    assert {node.status.state for node in (first, second, wrong)} == {NodeState.PASSIVE}
    first.send(CanFrame(2))
    bus.run_ns(5_000_000)
    assert second.ids == [2]
    assert wrong.status.sent == 0


# --- two with the same identifier ----------------------------------------------------------------


def test_the_same_frame_of_two_nodes_is_one_frame():
    bus = Bus()
    one, other, keeper = bus.add(CanNode()), bus.add(CanNode()), bus.add(Keeper())
    bus.begin()
    for node in (one, other):
        node.send(CanFrame(0x700, b"\1\2"))
    bus.run_ns(1_000_000)
    assert keeper.ids == [0x700]
    assert one.status.sent == other.status.sent == 1


def test_two_nodes_with_one_identifier_disturb_each_other():
    bus = Bus()
    one, other, keeper = bus.add(CanNode()), bus.add(CanNode()), bus.add(Keeper())
    bus.begin()
    one.send(CanFrame(0x700, b"\1"))
    other.send(CanFrame(0x700, b"\2"))
    bus.run_ns(20_000_000)
    assert one.status.failed >= 16
    assert sorted(frame.data for frame in keeper.frames) == [b"\1", b"\2"]


# --- bookkeeping ---------------------------------------------------------------------------------


def test_queues_have_ends_and_count_what_has_no_room():
    bus = Bus()

    class Slow(Keeper):
        queues = (4, 3)

        def take(self):
            pass

    sender, slow = bus.add(Slow("sender")), bus.add(Slow("slow"))
    bus.begin()
    assert not sender.send(*(CanFrame(n) for n in range(6)))
    assert sender.status.refused == 2
    bus.run_ns(1_000_000)
    assert (slow.status.received, slow.status.overflowed) == (4, 1)
    assert [f.id for f in bus.receive(slow.place)] == [0, 1, 2]


def test_a_node_without_power_is_gone_and_forgets_all():
    bus = Bus()
    sender, keeper = bus.add(CanNode()), bus.add(Keeper())
    bus.begin()
    keeper.power(False)
    sender.send(CanFrame(1), CanFrame(2))
    bus.run_ns(1_000_000)
    assert sender.status.sent == 0
    sender.power(False)
    assert sender.status.state == NodeState.NO_POWER
    keeper.power(True)
    sender.power(True)
    bus.run_ns(1_000_000)
    assert keeper.ids == []
    assert sender.status.transmit_errors == sender.status.failed == 0


def test_cancelled_frames_are_not_sent_but_for_that_on_the_wire():
    bus = Bus()
    sender, keeper = bus.add(CanNode()), bus.add(Keeper())
    bus.begin()
    sender.send(*(CanFrame(n) for n in range(5)))
    bus.run_ns(70 * BIT)  # in the middle of the second
    bus.cancel(sender.place)
    bus.run_ns(1_000_000)
    assert keeper.ids == [0, 1]
    assert (sender.status.sent, sender.status.dropped) == (2, 3)


def test_filters():
    bus = Bus()

    class Picky(Keeper):
        filters = (Filter(5), Filter(0x10, 0x12, extended=None), Filter(0x20, 0x20, extended=True))

    sender, picky = bus.add(CanNode()), bus.add(Picky())
    bus.begin()
    for number in (4, 5, 0x11, 0x13, 0x20):
        sender.send(CanFrame(number), CanFrame(number, extended=True))
    bus.run_ns(2_000_000)
    found = [(f.id, f.extended) for f in picky.frames]
    assert found == [(5, False), (0x11, False), (0x11, True), (0x20, True)]


@given(
    st.lists(
        st.one_of(
            st.tuples(st.just("send"), st.integers(0, 2), st.integers(0, 0x7FF)),
            st.tuples(st.just("run"), st.integers(1, 2_000_000)),
            st.tuples(st.just("noise"), st.sampled_from((0.0, 0.2))),
            st.tuples(st.just("cancel"), st.integers(0, 2)),
            st.tuples(st.just("stuck"), st.sampled_from(Stuck)),
        ),
        max_size=60,
    )
)
def test_every_frame_is_somewhere(actions):
    bus = Bus()
    nodes = [bus.add(Keeper(str(n))) for n in range(3)]
    for node in nodes:
        node.given = 0
    for action, *values in actions:
        if action == "send":
            nodes[values[0]].send(CanFrame(values[1], bytes([values[0]])))
            nodes[values[0]].given += 1
        elif action == "run":
            bus.run_ns(values[0])
        elif action == "noise":
            bus.set_noise(values[0])
        elif action == "cancel":
            bus.cancel(nodes[values[0]].place)
        else:
            bus.set_stuck(values[0])
    bus.run_ns(1)
    total = 0
    for node in nodes:
        status = node.status
        assert node.given == status.sent + status.transmit_pending + status.dropped + status.refused
        total += status.sent
    for node in nodes:
        state = node.status
        assert state.received == len(node.frames)
        if not any(n.status.bus_offs for n in nodes):
            assert len(node.frames) == total - state.sent


# --- traffic -------------------------------------------------------------------------------------


@pytest.mark.parametrize("length", [0, 1, 3, 8])
@pytest.mark.parametrize("extended", [False, True])
def test_a_full_bus(length, extended):
    bus = Bus()
    load = Traffic(0x100, span=64, extended=extended, length=length)
    sender, checker = bus.add(CanNode(traffic=[load])), bus.add(CanNode(checks=[load]))
    bus.run_ns(1_000_000_000)
    status = bus.status()
    assert status.busy_ns > 0.999 * (1_000_000_000 - 20 * BIT)
    shortest = (67 if extended else 47) + 8 * length
    assert 0.75 * 1e6 / shortest < sender.status.sent <= 1e6 / shortest
    result = checker.check_results[0]
    assert (result.lost, result.doubled, result.wrong) == (0, 0, 0)
    assert result.received == sender.status.sent


def test_a_check_finds_what_is_missing_and_what_comes_twice():
    bus = Bus()
    load = Traffic(0x100, length=2)
    sender, checker = bus.add(CanNode()), bus.add(CanNode(checks=[load]))
    bus.begin()
    for number in (5, 6, 9, 9, 8, 10):
        sender.send(CanFrame(0x100, number.to_bytes(2, "little")))
    sender.send(CanFrame(0x100, b"\0"), CanFrame(0x101, b"\0\0"))
    bus.run_ns(2_000_000)
    result = checker.check_results[0]
    assert (result.received, result.lost, result.doubled, result.wrong) == (7, 2, 2, 1)


def test_a_sensor_with_many_frames():
    """500 a second, and 13 of 100: 1800 extended frames a second."""
    bus = Bus()
    loads = [Traffic(0x18FF0000, extended=True, rate=500)]
    loads += [Traffic(0x18FF0100 + n, extended=True, rate=100) for n in range(13)]
    sensor, checker = bus.add(CanNode(traffic=loads)), bus.add(CanNode(checks=loads))
    bus.run_ns(1_000_000_000)
    assert 1795 <= sensor.status.sent <= 1815
    assert all(result.lost == 0 for result in checker.check_results)


def test_an_echo_comes_back_with_another_identifier():
    bus = Bus()
    keeper = bus.add(Keeper())
    bus.add(CanNode("echo", echo=0x400))
    bus.begin()
    keeper.send(CanFrame(0x123, b"abc"), CanFrame(0x124, remote=True))
    bus.run_ns(1_000_000)
    assert [(f.id, f.data) for f in keeper.frames] == [(0x523, b"abc")]


def test_what_cannot_be():
    with pytest.raises(UsageError, match="0x800"):
        CanFrame(0x800)
    with pytest.raises(UsageError, match="8 data bytes"):
        CanFrame(1, bytes(9))
    with pytest.raises(UsageError, match="at most 32 nodes"):
        bus = Bus()
        for _ in range(33):
            bus.add(CanNode())
