"""A drive on a bench, in steps of one millisecond, as the tests of drives use it."""

from ecatsim.devices.library import make

TURN = 65536
HALT, NEW, IMMEDIATELY, RELATIVE = 0x100, 0x10, 0x20, 0x40
REACHED, LIMIT, BIT_12, BIT_13 = 0x400, 0x800, 0x1000, 0x2000
NAMES = {
    "word": 0x6040,
    "mode": 0x6060,
    "position": 0x607A,
    "speed": 0x60FF,
    "torque": 0x6071,
}


class Bench:
    def __init__(self, name="CiA402", **parameters):
        self.drive, self.now = make(name, **parameters), 0.0
        self.words = []
        self.drive.step(0.0)

    def __getitem__(self, key):
        return self.drive[key if isinstance(key, tuple) else (key, 0)]

    def __setitem__(self, key, value):
        self.drive[key if isinstance(key, tuple) else (key, 0)] = value

    def set(self, **values):
        for name, value in values.items():
            self[NAMES[name]] = value
        return self

    def run(self, seconds):
        for _ in range(round(seconds * 1000)):
            self.now += 0.001
            self.drive.step(self.now)
            self.words.append(self.status)
        return self

    def until(self, condition, seconds=10.0):
        for _ in range(round(seconds * 1000)):
            if condition(self):
                return self
            self.run(0.001)
        raise AssertionError(f"status word 0x{self.status:04X} after {seconds} s")

    def enable(self, mode):
        self.set(mode=mode)
        for word in (0x06, 0x07, 0x0F):
            self.set(word=word).run(0.002)
        assert self.state == 0x27
        return self

    @property
    def status(self):
        return self[0x6041]

    @property
    def state(self):
        """The state bits of the status word; x is 0 where the standard does not care."""
        bits = self.status & 0x6F
        return bits & 0x4F if bits & 0x40 or bits & 0x0F in (0x08, 0x0F) else bits

    @property
    def speed(self):
        return self[0x606C]

    @property
    def position(self):
        return self[0x6064]
