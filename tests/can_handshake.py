"""A master's side of the handshake with a CAN terminal, for masters of tests.

It is written after the table of terminals, and knows nothing of ecatd or the simulator.
"""

from ecatsim.can import CanFrame


class Handshake:
    """Takes received frames out of inputs, and puts frames into outputs.

    Args:
        layout: The layout of the terminal.
        receive_queue: Most received frames in the inputs.
        send_queue: Most frames to be sent in the outputs.
    """

    def __init__(self, layout, receive_queue, send_queue):
        self.layout = layout
        self.send_queue = send_queue
        self.outputs = bytearray(layout.output_bytes(send_queue))
        self.input_size = layout.input_bytes(receive_queue)
        self.transaction = 0
        self.pending = []

    def begin(self, inputs):
        """Begins where the counters of the terminal are."""
        outputs = self.layout.outputs
        outputs.rx_ack.write(self.outputs, self.layout.inputs.rx_counter.read(inputs))
        outputs.tx_counter.write(self.outputs, self.layout.inputs.tx_echo.read(inputs))
        outputs.tx_count.write(self.outputs, 0)

    def cycle(self, inputs):
        """Takes what has come, and gives what goes; returns received frames."""
        layout = self.layout
        counter = layout.inputs.rx_counter.read(inputs)
        got = []
        if counter != layout.outputs.rx_ack.read(self.outputs):
            got = [self.frame(inputs, i) for i in range(layout.inputs.rx_count.read(inputs))]
            layout.outputs.rx_ack.write(self.outputs, counter)
        echo = layout.inputs.tx_echo.read(inputs)
        if self.pending and echo == layout.outputs.tx_counter.read(self.outputs):
            batch, self.pending = self.pending[: self.send_queue], self.pending[self.send_queue :]
            for number, frame in enumerate(batch):
                self.write(number, frame)
            layout.outputs.tx_count.write(self.outputs, len(batch))
            layout.outputs.tx_counter.write(self.outputs, (echo + 1) & 0xFFFF)
        return got

    def frame(self, inputs, number):
        """A received frame of the inputs."""
        messages = self.layout.received
        block = inputs[messages.end(number) : messages.end(number + 1)]
        length, remote = messages.length.read(block), bool(messages.remote.read(block))
        data = b"" if remote else bytes(block[messages.data : messages.data + length])
        extended = bool(messages.extended and messages.extended.read(block))
        return CanFrame(messages.identifier.read(block), data, extended, remote, length)

    def write(self, number, frame):
        """Writes a frame to the outputs."""
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
