"""CAN buses whose time a test runs, and a master for the terminals on them."""

import struct

from slave_bench import OP, SAFEOP, Bench

from ecatd.etg.can_terminals import Layout, Settings
from ecatsim.can import CanBus, CanFrame, CanNode

MBIT = 1_000_000
BIT = 1000  # ns at 1 Mbit/s


class Keeper(CanNode):
    """Keeps what it receives."""

    def __init__(self, name="keeper", bit_rate=0, **options):
        super().__init__(name, bit_rate, **options)
        self.frames = []

    def on_frame(self, frame):
        self.frames.append(frame)

    @property
    def ids(self):
        return [frame.id for frame in self.frames]


class Bus(CanBus):
    """A bus whose time passes by `run_ns` only."""

    def __init__(self, bit_rate=MBIT):
        self.now = 1_000_000_000  # 0 would be the clock of the machine
        super().__init__(bit_rate, clock=lambda: self.now)

    def run_ns(self, ns, step=100_000_000):
        end = self.now + ns
        while self.now < end:
            self.now = min(end, self.now + step)
            self.run(self.now / 1e9)
        return self

    def begin(self):
        """Nodes have seen an idle wire."""
        return self.run_ns(20 * BIT)


class BusBench(Bench):
    """A bench in the time of a CAN bus."""

    def process(self, frame):
        return self.segment.enter(frame, now_ns=self.device.can.bus.now).frame

    def run(self, seconds=0.001):
        self.now = self.device.can.bus.now / 1e9
        return super().run(seconds)


class Master:
    """The handshake of a master with one terminal, a cycle at a time."""

    def __init__(self, terminal, bus_rate=1000, *, identifiers=11, queue=8, filters=()):
        self.bench = BusBench(terminal)
        self.terminal = terminal
        told = terminal.told
        self.queue = told.queue_max if told.queue_fixed else queue
        self.layout: Layout = told.layouts[identifiers]
        self.settings = Settings(
            bit_rate=bus_rate,
            cycle_us=1000,
            identifiers=identifiers,
            receive_queue=self.queue,
            send_queue=self.queue,
            flags=8 if identifiers == 29 else 0,
            filters=tuple(filters),
        )
        self.sizes = {
            "outputs": self.layout.output_bytes(self.queue),
            "inputs": self.layout.input_bytes(self.queue),
        }
        self.transaction = 0
        self.pending = []

    def preop(self):
        self.bench.preop()
        for item in self.terminal.told.written(self.settings):
            self.bench.download(item.index, item.subindex, item.data, item.complete)
        return self

    def safeop(self):
        self.bench.set_process_data(**self.sizes)
        assert self.bench.request(SAFEOP) == (SAFEOP, 0)
        self.outputs = bytearray(self.sizes["outputs"])
        return self

    def op(self):
        self.bench.request(OP)
        self.bench.put(bytes(self.outputs))
        assert self.bench.pump().al() == (OP, 0)
        return self.resume()

    def resume(self):
        """Begins where the counters of the terminal are."""
        inputs, outputs = self.inputs(), self.layout.outputs
        outputs.rx_ack.write(self.outputs, self.layout.inputs.rx_counter.read(inputs))
        outputs.tx_counter.write(self.outputs, self.layout.inputs.tx_echo.read(inputs))
        outputs.tx_count.write(self.outputs, 0)
        return self

    def start(self):
        return self.preop().safeop().op()

    def inputs(self):
        return self.bench.get()

    def status(self, name):
        at = self.layout.status_at(self.queue)
        return getattr(self.layout.status, name).read(self.inputs()[at:])

    def put(self):
        self.bench.put(bytes(self.outputs))

    def send(self, *frames):
        self.pending += frames

    def cycle(self):
        """Takes what has come, gives what goes, and exchanges; returns received frames."""
        inputs, layout = self.inputs(), self.layout
        counter = layout.inputs.rx_counter.read(inputs)
        got = []
        if counter != layout.outputs.rx_ack.read(self.outputs):
            got = [self.frame(inputs, i) for i in range(layout.inputs.rx_count.read(inputs))]
            layout.outputs.rx_ack.write(self.outputs, counter)
        echo = layout.inputs.tx_echo.read(inputs)
        if self.pending and echo == layout.outputs.tx_counter.read(self.outputs):
            batch, self.pending = self.pending[: self.queue], self.pending[self.queue :]
            for number, frame in enumerate(batch):
                self.write(number, frame)
            layout.outputs.tx_count.write(self.outputs, len(batch))
            layout.outputs.tx_counter.write(self.outputs, (echo + 1) & 0xFFFF)
        self.put()
        return got

    def frame(self, inputs, number):
        messages = self.layout.received
        block = inputs[messages.end(number) : messages.end(number + 1)]
        length, remote = messages.length.read(block), bool(messages.remote.read(block))
        data = b"" if remote else bytes(block[messages.data : messages.data + length])
        extended = bool(messages.extended and messages.extended.read(block))
        return CanFrame(messages.identifier.read(block), data, extended, remote, length)

    def write(self, number, frame):
        messages = self.layout.sent
        block = bytearray(messages.stride)
        messages.length.write(block, frame.size)
        messages.identifier.write(block, frame.id)
        messages.remote.write(block, frame.remote)
        if messages.extended:
            messages.extended.write(block, frame.extended)
        if messages.transaction:
            self.transaction = (self.transaction + 1) & 0xFFFF
            messages.transaction.write(block, self.transaction)
        block[messages.data : messages.data + len(frame.data)] = frame.data
        self.outputs[messages.end(number) : messages.end(number + 1)] = block


def numbered(frame):
    """The number in the data of a frame of `Traffic` with 8 bytes."""
    return struct.unpack("<Q", frame.data)[0]
