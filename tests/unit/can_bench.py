"""CAN buses whose time a test runs, and a master for the terminals on them."""

from slave_bench import OP, SAFEOP, Bench

from can_handshake import Handshake
from ecatd.etg.can_terminals import Settings
from ecatsim.can import CanBus, CanNode

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
    """A master in OP with one terminal, a cycle at a time."""

    def __init__(self, terminal, bus_rate=1000, *, identifiers=11, queue=8, filters=()):
        self.bench = BusBench(terminal)
        self.terminal = terminal
        told = terminal.told
        self.queue = told.queue_max if told.queue_fixed else queue
        self.layout = told.layouts[identifiers]
        self.settings = Settings(
            bit_rate=bus_rate,
            cycle_us=1000,
            identifiers=identifiers,
            receive_queue=self.queue,
            send_queue=self.queue,
            flags=8 if identifiers == 29 else 0,
            filters=tuple(filters),
        )
        self.can = Handshake(self.layout, self.queue, self.queue)

    @property
    def outputs(self):
        return self.can.outputs

    def preop(self):
        self.bench.preop()
        for item in self.terminal.told.written(self.settings):
            self.bench.download(item.index, item.subindex, item.data, item.complete)
        return self

    def safeop(self):
        self.bench.set_process_data(len(self.outputs), self.can.input_size)
        assert self.bench.request(SAFEOP) == (SAFEOP, 0)
        return self

    def op(self):
        self.bench.request(OP)
        self.put()
        assert self.bench.pump().al() == (OP, 0)
        self.can.begin(self.inputs())
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
        self.can.pending += frames

    def cycle(self):
        """Makes a cycle; returns received frames."""
        got = self.can.cycle(self.inputs())
        self.put()
        return got
