"""A master for unit tests: frames straight into a segment, and time that the test runs.

It is written against the standards, and knows nothing of the devices but their SII image.
"""

import struct

from ecatd.base.errors import SdoAbortError
from ecatsim.esc import Segment

INIT, PREOP, BOOT, SAFEOP, OP = 1, 2, 3, 4, 8
ERROR = ACK = 0x10
APRD, APWR, LRW = 1, 2, 12
COE, FOE = 3, 4
MAILBOX_OUT, MAILBOX_IN, OUTPUTS, INPUTS = 1, 2, 3, 4


class Bench:
    """One device or several on a segment, and the master's side of the wire."""

    def __init__(self, *devices):
        self.devices = devices
        self.segment = Segment()
        self.now = 1000.0
        outputs = inputs = 0
        for device in devices:
            device.attach(self.segment, outputs, inputs)
            outputs += device.room[0]
            inputs += device.room[1]
        self.segment.make_images(outputs, inputs)
        self.device = devices[0]
        self.counter = 0
        self.sizes = {}

    # --- time ----------------------------------------------------------------------------------

    def pump(self):
        """Lets the devices react to what has come."""
        for position, event in self.segment.wait(0):
            self.devices[position].handle(event, self.now)
        return self

    def run(self, seconds=0.001):
        for _ in range(max(1, round(seconds * 1000))):
            self.now += 0.001
            self.segment.get_outputs(round(self.now * 1e9))
            for device in self.devices:
                device.take_outputs()
                if not device.sleeps:
                    device.run(self.now)
            self.segment.put_inputs()
            self.pump()
        return self

    # --- frames --------------------------------------------------------------------------------

    def process(self, frame):
        return self.segment.process(frame)

    def datagram(self, command, address, data):
        head = struct.pack("<BBIHH", command, 0, address, len(data), 0)
        body = head + data + b"\0\0"
        raw = b"\xff" * 6 + bytes(6) + b"\x88\xa4" + struct.pack("<H", len(body) | 0x1000) + body
        answer = self.process(raw.ljust(60, b"\0"))
        at = 16 + len(head)
        return answer[at : at + len(data)], int.from_bytes(answer[at + len(data) :][:2], "little")

    def read(self, register, size, position=0):
        data, counter = self.datagram(APRD, -position & 0xFFFF | register << 16, bytes(size))
        return data if counter else None

    def word(self, register):
        return int.from_bytes(self.read(register, 2), "little")

    def write(self, register, data, position=0):
        """The working counter."""
        return self.datagram(APWR, -position & 0xFFFF | register << 16, data)[1]

    # --- set-up --------------------------------------------------------------------------------

    def defaults(self):
        """Sync managers as the SII describes them: channel, start, size, control, enable, type."""
        image, at = self.device.sii_image(), 128
        while True:
            kind, words = struct.unpack_from("<HH", image, at)
            if kind == 41:
                body = image[at + 4 : at + 4 + 2 * words]
                fields = struct.iter_unpack("<HHBBBB", body)
                return [(i, a, n, c, e, t) for i, (a, n, c, _, e, t) in enumerate(fields)]
            at += 4 + 2 * words

    def set_sm(self, channel, start, size, control, enable=1):
        base = 0x0800 + 8 * channel
        self.write(base + 6, b"\0")
        self.write(base, struct.pack("<HHBx", start, size, control))
        self.write(base + 6, bytes([enable]))
        self.sizes[channel] = (start, size)

    def set_mailboxes(self):
        for channel, start, size, control, _, kind in self.defaults():
            if kind in (MAILBOX_OUT, MAILBOX_IN):
                self.set_sm(channel, start, size, control)

    def set_process_data(self, outputs=None, inputs=None):
        """Sets the process data channels, with other sizes than the default ones if given."""
        for channel, start, size, control, _, kind in self.defaults():
            size = {OUTPUTS: outputs, INPUTS: inputs}.get(kind) if kind > 2 else size
            if kind in (OUTPUTS, INPUTS):
                default = next(d[2] for d in self.defaults() if d[0] == channel)
                size = default if size is None else size
                self.set_sm(channel, start, size, control, int(size > 0))

    def request(self, control):
        """AL status and AL status code after a request."""
        self.write(0x0120, struct.pack("<H", control))
        self.pump()
        return self.al()

    def al(self):
        return self.word(0x0130), self.word(0x0134)

    def preop(self):
        self.set_mailboxes()
        assert self.request(PREOP) == (PREOP, 0)
        return self

    def safeop(self, **sizes):
        self.preop().set_process_data(**sizes)
        assert self.request(SAFEOP) == (SAFEOP, 0)
        return self

    def op(self, outputs):
        self.request(OP)
        self.put(outputs)
        assert self.pump().al() == (OP, 0)
        return self

    def put(self, data):
        channel = next(d[0] for d in self.defaults() if d[5] == OUTPUTS)
        assert self.write(self.sizes[channel][0], data) == 1

    def get(self):
        channel = next(d[0] for d in self.defaults() if d[5] == INPUTS)
        return self.read(*self.sizes[channel])

    # --- mailbox -------------------------------------------------------------------------------

    def post(self, protocol, body, *, counter=None, length=None):
        """Writes a mail; the working counter."""
        if counter is None:
            self.counter = counter = self.counter % 7 + 1
        size = len(body) if length is None else length
        mail = struct.pack("<HHBB", size, 0, 0, protocol | counter << 4) + body
        start, room = self.sizes[0]
        result = self.write(start, mail.ljust(room, b"\0"))
        self.pump()
        return result

    def fetch(self):
        """The protocol and the body of the next mail; None if there is none."""
        raw = self.read(*self.sizes[1])
        self.pump()
        if raw is None:
            return None
        length = struct.unpack_from("<H", raw)[0]
        return raw[5] & 0x0F, raw[6 : 6 + length]

    def ask(self, protocol, body):
        """The body of the answer to a mail."""
        assert self.post(protocol, body) == 1
        kind, answer = self.fetch()
        assert kind == protocol, answer.hex()
        return answer

    def sdo(self, request):
        answer = self.ask(COE, struct.pack("<H", 2 << 12) + request)
        if answer[2] == 0x80:
            raise SdoAbortError(struct.unpack_from("<I", answer, 6)[0])
        return answer[2:]

    def upload(self, index, subindex=0, complete=False):
        """Data that fit into one mail."""
        reply = self.sdo(struct.pack("<BHBI", 0x40 | complete << 4, index, subindex, 0))
        if reply[0] & 0x02:
            return reply[4 : 8 - (reply[0] >> 2 & 3)]
        size = struct.unpack_from("<I", reply, 4)[0]
        assert len(reply) == 8 + size
        return reply[8:]

    def download(self, index, subindex, data, complete=False):
        bits = 0x20 | complete << 4
        if len(data) <= 4:
            bits |= 0x03 | (4 - len(data)) << 2
            self.sdo(struct.pack("<BHB", bits, index, subindex) + data.ljust(4, b"\0"))
        else:
            self.sdo(struct.pack("<BHBI", bits | 1, index, subindex, len(data)) + data)
