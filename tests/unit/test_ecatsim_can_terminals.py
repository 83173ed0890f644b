"""Simulated CAN terminals: a master does the handshake with frames on the EtherCAT segment."""

import pytest
from can_bench import MBIT, Bus, Keeper, Master
from slave_bench import INIT, OP, PREOP, SAFEOP

from ecatd.base.errors import SdoAbortError
from ecatd.etg.can_terminals import Mode
from ecatsim.can import CanFrame, CanNode, NodeState, Traffic
from ecatsim.devices.can_terminals import C2922, EL6751CAN, KendrionCAN
from ecatsim.devices.library import make

KINDS = [(EL6751CAN, 11), (EL6751CAN, 29), (C2922, 11), (C2922, 29), (KendrionCAN, 29)]


class Rig:
    """A terminal on a bus; the time of the bus is that of the test."""

    def __init__(self, kind=EL6751CAN, identifiers=11, queue=8, filters=(), **options):
        self.bus = Bus()
        self.keeper = self.bus.add(Keeper())
        self.terminal = kind(self.bus, **options)
        self.bus.bit_rate = MBIT
        self.master = Master(self.terminal, identifiers=identifiers, queue=queue, filters=filters)
        self.can = self.terminal.can

    def start(self):
        self.master.start()
        self.bus.begin()
        return self

    def cycles(self, count, ns=1_000_000):
        """Received frames of some EtherCAT cycles."""
        got = []
        for _ in range(count):
            self.bus.run_ns(ns)
            got += self.master.cycle()
        return got


@pytest.fixture(params=KINDS, ids=lambda item: f"{item[0].__name__}-{item[1]}")
def rig(request):
    kind, identifiers = request.param
    return Rig(kind, identifiers).start()


def samples(wide):
    frames = [
        CanFrame(0x7FF, b"12345678"),
        CanFrame(0, b""),
        CanFrame(0x123, remote=True, length=3),
    ]
    if wide:
        frames += [
            CanFrame(0x1FFFFFFF, b"\xff" * 8, extended=True),
            CanFrame(5, b"\1", extended=True),
            CanFrame(6, extended=True, remote=True),
        ]
    return frames


def shown(frames):
    return [(f.id, f.data, f.extended, f.remote, f.size) for f in frames]


def test_frames_of_every_kind_come_and_go(rig):
    frames = samples(rig.master.settings.identifiers == 29)
    rig.keeper.send(*frames)
    assert shown(rig.cycles(12)) == shown(frames)
    rig.master.send(*frames)
    rig.cycles(12)
    assert shown(rig.keeper.frames) == shown(frames)


def test_many_frames_each_way_arrive_once_and_in_order(rig):
    wide = rig.master.settings.identifiers == 29
    there = Traffic(0x100, extended=wide, rate=1500)
    back = Traffic(0x200, extended=wide)
    rig.bus.add(CanNode("sensor", traffic=[there]))
    judge = rig.bus.add(CanNode("judge", checks=[back]))
    got = []
    for number in range(400):
        rig.master.send(CanFrame(0x200, number.to_bytes(8, "little"), wide))
        got += rig.cycles(1)
    got += rig.cycles(20)
    numbers = [int.from_bytes(f.data, "little") for f in got if f.id == 0x100]
    assert len(numbers) > 550
    assert numbers == list(range(len(numbers)))
    result = judge.check_results[0]
    assert (result.received, result.lost, result.doubled) == (400, 0, 0)


def test_the_transaction_number_is_that_of_the_frame_on_the_wire_last():
    rig = Rig().start()
    number = rig.master.layout.inputs.transaction
    rig.keeper.power(False)  # nobody acknowledges
    rig.master.send(CanFrame(1), CanFrame(2), CanFrame(3))
    rig.cycles(10)
    assert number.read(rig.master.inputs()) == 0
    assert rig.terminal.can.status.transmit_pending == 3
    rig.keeper.power(True)
    rig.cycles(3)
    assert number.read(rig.master.inputs()) == 3
    assert rig.keeper.ids == [1, 2, 3]


@pytest.mark.parametrize("cycles", [1, 2, 4])
def test_the_answer_takes_so_many_cycles(cycles):
    rig = Rig(handshake_cycles=cycles).start()
    layout = rig.master.layout
    rig.master.send(CanFrame(1))
    rig.master.cycle()
    waited = 1
    while layout.inputs.tx_echo.read(rig.master.inputs()) != 1:
        rig.cycles(1)
        waited += 1
    assert waited == cycles
    rig.keeper.send(CanFrame(7))
    assert rig.cycles(2)  # it had nothing to do, so it is ready
    for number in range(20):
        rig.keeper.send(CanFrame(number))
    batches, since = [], 0
    while sum(batches) < 20:
        if got := rig.cycles(1):
            batches.append(len(got))
            since = 0
        since += 1
        assert since <= cycles + 1
    assert max(batches) == 8


def test_filters_and_extended_frames_in_a_terminal_for_11_bit():
    rig = Rig(filters=[(0x100, 0x1FF), (0x300, 0x300)]).start()
    for number in (0xFF, 0x100, 0x1FF, 0x200, 0x300):
        rig.keeper.send(CanFrame(number), CanFrame(number, extended=True))
    assert shown(rig.cycles(10)) == shown(CanFrame(n) for n in (0x100, 0x1FF, 0x300))


def test_received_frames_without_room_are_lost_and_told():
    rig = Rig(kept=16).start()
    rig.keeper.send(*(CanFrame(n) for n in range(40)))
    rig.bus.run_ns(20_000_000)  # meanwhile no cycle comes
    rig.master.put()
    assert rig.master.status("receive_overflow")
    assert rig.terminal.can.status.overflowed == 24
    assert [f.id for f in rig.cycles(20)] == list(range(16))
    assert not rig.master.status("receive_overflow")


def test_frames_to_be_sent_wait_for_room():
    rig = Rig(kept=12).start()
    rig.keeper.power(False)
    rig.master.send(*(CanFrame(n) for n in range(40)))
    rig.cycles(50)
    assert rig.terminal.can.status.transmit_pending == 8
    rig.keeper.power(True)
    rig.cycles(50)
    assert rig.keeper.ids == list(range(40))


def test_bus_off_stays_until_init():
    rig = Rig().start()
    rig.bus.force_bus_off(rig.can.place)
    rig.cycles(2)
    assert rig.master.status("bus_off")
    rig.master.send(CanFrame(1))
    rig.cycles(2000)
    assert rig.keeper.frames == []
    assert rig.master.bench.request(INIT) == (INIT, 0)
    assert rig.can.status.state == NodeState.NO_POWER
    rig.master.can.pending = []
    rig.start()
    rig.cycles(2)
    assert not rig.master.status("bus_off")
    rig.master.send(CanFrame(2))
    rig.cycles(5)
    assert rig.keeper.ids == [2]


def test_kendrion_comes_back_from_bus_off():
    rig = Rig(KendrionCAN, 29).start()
    rig.bus.force_bus_off(rig.can.place)
    rig.master.cycle()
    assert rig.master.status("bus_off")
    rig.cycles(3)
    assert not rig.master.status("bus_off")


def test_error_counters_and_warning():
    rig = Rig().start()
    rig.keeper.power(False)
    rig.master.send(CanFrame(1))
    rig.cycles(20)
    assert rig.master.status("send_errors") == 128
    assert rig.master.status("warning")
    assert rig.master.status("send_error")
    assert not rig.master.status("bus_off")
    assert rig.master.bench.upload(0xF108, 4) == b"\x80"


def test_counters_are_zero_after_init_and_after_power_on():
    rig = Rig().start()
    rig.keeper.send(CanFrame(1))
    rig.master.send(CanFrame(2))
    rig.cycles(6)
    assert rig.can.batches.rx_counter == rig.can.batches.tx_echo == 1
    assert rig.master.bench.request(SAFEOP) == (SAFEOP, 0)
    assert rig.master.bench.request(PREOP) == (PREOP, 0)
    rig.master.safeop().op()
    rig.cycles(2)
    assert rig.can.batches.rx_counter == rig.can.batches.tx_echo == 1
    rig.terminal.reset()
    assert rig.can.batches.rx_counter == rig.can.batches.tx_echo == 0


def test_what_waits_is_dropped_when_op_is_left():
    rig = Rig().start()
    rig.keeper.power(False)
    rig.master.send(*(CanFrame(n) for n in range(4)))
    rig.cycles(5)
    assert rig.master.bench.request(SAFEOP) == (SAFEOP, 0)
    rig.master.put()
    rig.bus.run_ns(1_000_000)
    rig.keeper.power(True)
    rig.bus.run_ns(10_000_000)
    assert rig.keeper.frames == []
    assert rig.can.status.dropped == 4


def test_frames_from_before_op_are_not_given():
    rig = Rig()
    rig.master.preop().safeop()
    rig.bus.begin()
    rig.keeper.send(CanFrame(1))
    rig.bus.run_ns(1_000_000)
    rig.master.op()
    rig.keeper.send(CanFrame(2))
    assert [f.id for f in rig.cycles(5)] == [2]


def test_fast_mode_gives_each_cycle_what_came_in_it():
    rig = Rig(mode=Mode.FAST).start()
    layout = rig.master.layout
    rig.keeper.send(*(CanFrame(n) for n in range(12)))
    rig.bus.run_ns(5_000_000)
    rig.master.put()  # without an acknowledgement
    inputs = rig.master.inputs()
    assert layout.inputs.rx_count.read(inputs) == 8
    assert rig.can.status.overflowed == 4
    rig.keeper.send(CanFrame(0x7F))
    rig.bus.run_ns(1_000_000)
    rig.master.put()
    inputs = rig.master.inputs()
    assert layout.inputs.rx_counter.read(inputs) == 2
    assert layout.inputs.rx_count.read(inputs) == 1
    assert rig.master.can.frame(inputs, 0).id == 0x7F
    assert rig.master.can.frame(inputs, 1).id == 1  # an old one


def test_optimized_mode_keeps_what_has_no_room_and_has_one_buffer():
    rig = Rig(mode=Mode.OPTIMIZED)
    words = rig.master.layout.inputs
    rig.master.preop().safeop()
    rig.master.bench.request(OP)
    rig.master.put()
    assert rig.master.bench.pump().al() == (OP, 0)
    assert rig.master.inputs() is not None
    assert rig.master.inputs() is None  # until the next outputs
    rig.bus.begin()
    rig.keeper.send(*(CanFrame(n) for n in range(20)))
    rig.bus.run_ns(3_000_000)
    got, counter = [], 0
    for _ in range(5):
        rig.master.put()
        inputs = rig.master.inputs()
        if words.rx_counter.read(inputs) != counter:
            counter = words.rx_counter.read(inputs)
            number = words.rx_count.read(inputs)
            got += [rig.master.can.frame(inputs, i).id for i in range(number)]
    assert got == list(range(20))
    assert counter == 3
    assert rig.can.status.overflowed == 0


def test_the_process_data_follow_the_queues():
    rig = Rig()
    rig.master.preop()
    bench = rig.master.bench
    for queues in ((32, 32), (1, 20)):
        bench.download(0x8000, 0, b"\0")
        for subindex, queue in zip((0x21, 0x22), queues, strict=True):
            bench.download(0x8000, subindex, bytes([queue]))
        bench.download(0x8000, 0, b"\x24")
        layout = rig.master.layout
        sizes = layout.output_bytes(queues[1]), layout.input_bytes(queues[0])
        bench.set_process_data(*sizes)
        assert bench.request(SAFEOP) == (SAFEOP, 0)
        assert bench.request(PREOP) == (PREOP, 0)
    bench.download(0x8000, 0, b"\0")
    with pytest.raises(SdoAbortError):
        bench.download(0x8000, 0x21, b"\x21")


def test_the_terminal_takes_part_before_op():
    rig = Rig()
    rig.master.preop()
    rig.bus.begin()
    rig.keeper.send(CanFrame(1))
    rig.bus.run_ns(1_000_000)
    assert rig.keeper.status.sent == 1
    assert rig.can.status.state == NodeState.ACTIVE


def test_nonsense_of_a_master_does_no_harm():
    rig = Rig().start()
    outputs = rig.master.layout.outputs
    outputs.tx_count.write(rig.master.outputs, 0xFFFF)
    outputs.tx_counter.write(rig.master.outputs, 1)
    for at in range(6, len(rig.master.outputs)):
        rig.master.outputs[at] = 0xFF  # 15 bytes of data
    rig.cycles(5)
    assert rig.can.batches.malformed == 9
    assert rig.keeper.frames == []


def test_the_library_has_them():
    terminal = make("EL6751CAN", handshake_cycles=4)
    assert terminal.can.bus.places == ["EL6751"]


def test_a_cycle_without_frames_of_the_master_still_tells_the_state():
    rig = Rig()
    rig.master.preop().safeop()
    rig.bus.force_bus_off(rig.can.place)
    rig.bus.run_ns(1)
    rig.master.bench.run(0.002)
    assert rig.master.status("bus_off")


@pytest.mark.parametrize("state", [PREOP, SAFEOP, OP])
def test_a_terminal_that_is_swapped_leaves_nothing_behind(state):
    rig = Rig()
    rig.master.preop()
    if state > PREOP:
        rig.master.safeop()
    if state > SAFEOP:
        rig.master.op()
    bench = rig.master.bench
    fresh = EL6751CAN(rig.bus)
    fresh.attach(bench.segment, 0, 0, place=0)
    rig.terminal.detach()
    bench.devices = (fresh,)
    bench.device = fresh
    rig.terminal = fresh
    rig.master.start()
    rig.bus.begin()
    rig.keeper.send(CanFrame(3))
    assert [f.id for f in rig.cycles(5)] == [3]
