"""The switch between this computer and slaves with EoE."""

from functools import partial

from ecatd.master.ethernet.switch import Switch

ALL = bytes(6 * [0xFF])


def mac(number: int) -> bytes:
    return bytes([2, 0, 0, 0, number >> 8, number & 0xFF])


class Bench:
    """A switch with ports that remember what was sent out of them."""

    def __init__(self, ports: int) -> None:
        self.sent: list[tuple[int, bytes]] = []
        self.switch = Switch([partial(self._send, port) for port in range(ports)])

    def _send(self, port: int, frame: bytes) -> None:
        self.sent.append((port, frame))

    def ports(self, receiver: bytes, sender: bytes, port: int) -> list[int]:
        """The ports out of which a frame goes that came in at a port."""
        self.sent.clear()
        frame = receiver + sender + b"data"
        self.switch.forward(frame, port)
        assert all(sent == frame for _, sent in self.sent)
        return [port for port, _ in self.sent]


def test_frames_go_only_to_their_receiver() -> None:
    bench = Bench(4)
    assert bench.ports(ALL, mac(1), 1) == [0, 2, 3]
    assert bench.ports(mac(9), mac(2), 2) == [0, 1, 3]  # nobody has seen it
    assert bench.ports(mac(1), mac(2), 2) == [1]
    assert bench.ports(mac(2), mac(1), 1) == [2]
    assert bench.ports(mac(2), mac(5), 2) == []  # behind the same port
    assert bench.switch.addresses(2) == ["02:00:00:00:00:02", "02:00:00:00:00:05"]


def test_an_address_that_moves_is_found_at_its_new_port() -> None:
    bench = Bench(3)
    bench.ports(ALL, mac(1), 1)
    bench.ports(ALL, mac(1), 2)
    assert bench.ports(mac(1), mac(7), 0) == [2]


def test_groups_are_no_senders_and_short_frames_go_nowhere() -> None:
    bench = Bench(3)
    bench.ports(mac(1), ALL, 1)
    assert bench.ports(ALL, mac(2), 2) == [0, 1]
    bench.switch.forward(b"short", 0)
    assert len(bench.sent) == 2


def test_the_table_does_not_grow_for_ever() -> None:
    bench = Bench(2)
    bench.ports(ALL, mac(5000), 0)
    for number in range(3000):
        bench.ports(ALL, mac(number), 1)
    assert len(bench.switch.addresses(1)) == 256
    assert bench.ports(mac(2999), mac(5000), 0) == [1]
    # A device that invents addresses makes others forget only its own.
    assert bench.ports(mac(5000), mac(2999), 1) == [0]
    assert len(bench.switch.addresses(0)) == 1
