"""IDNs of drives with SoE: the master's side against the slave's side of the simulator."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from conftest import names
from ecatd.base.errors import NoAnswerError, StateError, UsageError
from ecatd.etg.al import AlState
from ecatd.etg.idns import Attribute, Element, idn_text, parse_idn, split_elements
from ecatd.master.mailbox.conversation import Conversation
from ecatd.master.mailbox.mailbox import HEADER_BYTES, Mailbox, Protocol
from ecatd.master.mailbox.soe import read_idn, write_idn
from ecatsim.slave.soe import READ_ONLY, Idn, SoeServer
from rigs.files import IDNS, LIST, LONG, NUMBERS, SHORT, SIGNED, TEXT, UNSIGNED, WORDS

SIZE = 48


class Wire(Mailbox):
    """A mailbox whose messages go to a server in this process."""

    def __init__(self, server: SoeServer) -> None:
        self._server = server
        self._waiting: list[bytes] = []

    size = size_in = SIZE  # type: ignore[assignment]

    def ask(self, protocol, body, take, patience_s=None):  # type: ignore[no-untyped-def]
        assert protocol == Protocol.SOE
        assert len(body) <= SIZE - HEADER_BYTES
        self._waiting += self._server.handle(body)
        return (yield from self.more(protocol, take))

    def more(self, protocol, take):  # type: ignore[no-untyped-def]
        assert all(len(mail) <= SIZE - HEADER_BYTES for mail in self._waiting)
        while self._waiting:
            taken = take(self._waiting.pop(0))
            if taken is not None:
                return taken
        raise NoAnswerError("nothing")
        yield []

    def send(self, protocol: Protocol, body: bytes) -> Conversation[None]:
        assert self._server.handle(body) == []
        return
        yield []


def served(idns: dict[str, Idn], state: AlState = AlState.OP) -> Wire:
    server = SoeServer([{parse_idn(name): idn for name, idn in idns.items()}], lambda: state)
    server.start(SIZE)
    return Wire(server)


def run(conversation: Conversation[object]) -> object:
    try:
        while True:
            next(conversation)
    except StopIteration as end:
        return end.value


def test_an_idn_goes_both_ways() -> None:
    wire = served(
        {name: Idn(**{f: getattr(i, f) for f in i.__slots__}) for name, i in IDNS.items()}
    )
    for name, text in (
        ("S-0-0001", "2000 us"),
        ("S-0-0030", "1.0 µ"),
        ("S-0-0047", "-0.1 mm"),
        ("P-0-0100", "5 %"),
    ):
        found = run(read_idn(wire, 0, parse_idn(name)))
        assert found.name == IDNS[name].name
        assert f"{found.attribute.decode(found.value)} {found.unit}".rstrip() == text
    for name, text, value in (
        ("S-0-0001", "0x1F4", 500),
        ("S-0-0030", "another version that is long enough for two messages", None),
        ("S-0-0047", "-12.5", -12.5),
        ("P-0-0200", ",".join(map(str, range(100))), [*range(100)]),
    ):
        number = parse_idn(name)
        attribute = run(read_idn(wire, 0, number)).attribute
        data = attribute.encode(text)
        run(write_idn(wire, 0, number, data, is_list=attribute.is_list))
        found = run(read_idn(wire, 0, number))
        assert found.attribute.decode(found.value) == (text if value is None else value)


def test_what_a_drive_refuses_is_said() -> None:
    wire = served(IDNS)
    for conversation, code in (
        (read_idn(wire, 0, parse_idn("S-0-0099")), "0x1001"),
        (read_idn(wire, 1, parse_idn("S-0-0001")), "0x1001"),
        (write_idn(wire, 0, 1, b"\0\0", is_list=False), "0x7006"),
        (write_idn(wire, 0, 1, b"\xff\xff", is_list=False), "0x7007"),
        (write_idn(wire, 0, 1, b"\0", is_list=False), "0x7002"),
        (write_idn(wire, 0, 1, b"\0\0\0", is_list=False), "0x7003"),
        (write_idn(wire, 0, parse_idn("P-0-0100"), b"\0\0", is_list=False), "0x7005"),
    ):
        with pytest.raises(StateError) as caught:
            run(conversation)
        names(caught.value, f"SoE error {code}")


@pytest.mark.parametrize("text", ["S-0-0000", "S-7-4095", "P-0-0001", "P-3-0100"])
def test_names_of_idns(text: str) -> None:
    assert idn_text(parse_idn(text)) == text


@pytest.mark.parametrize("text", ["", "47", "S-8-0001", "S-0-4096", "X-0-0001", "S-0-"])
def test_wrong_names(text: str) -> None:
    with pytest.raises(UsageError):
        parse_idn(text)


def test_values_of_all_kinds() -> None:
    for raw, text, data in (
        (LONG | SIGNED | 3 << 24, "-1.5", struct.pack("<i", -1500)),
        (LONG | 6 << 20, "0.5", struct.pack("<f", 0.5)),
        (SHORT | NUMBERS, "P-0-0100", struct.pack("<H", 0x8064)),
        (SHORT | 3 << 20, "0x00FF", b"\xff\0"),
        (LIST | UNSIGNED, "1, 2, 3", struct.pack("<3H", 1, 2, 3)),
        (TEXT | WORDS, "text", b"text"),
    ):
        attribute = Attribute(raw)
        assert attribute.encode(text) == data
        found = attribute.decode(data)
        assert (", ".join(map(str, found)) if isinstance(found, list) else str(found)) == text
    assert Attribute(1 << 28 | 1 << 30).protected == ["PREOP", "OP"]
    for raw, text in ((SHORT | UNSIGNED, "70000"), (SHORT | UNSIGNED, "x"), (0, "1")):
        with pytest.raises(UsageError):
            Attribute(raw).encode(text)


@given(st.integers(-(1 << 63), (1 << 63) - 1), st.integers(0, 15))
def test_no_digit_is_lost(value: int, decimals: int) -> None:
    attribute = Attribute(3 << 16 | SIGNED | decimals << 24)
    data = value.to_bytes(8, "little", signed=True)
    assert attribute.encode(attribute.text(data)) == data


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1.23456", ["1.23456", "4 decimals", "1.2346"]),
        ("1e-9", ["1e-9", "0.0"]),
        ("123456.7890123456789012345678901234567890", ["123456.789"]),
        ("1e999999999", ["1e999999999", "4 bytes"]),
        ("214748.3648", ["214748.3648", "4 bytes"]),
        ("nan", ["'nan'", "number"]),
    ],
)
def test_a_value_that_the_idn_cannot_have_is_refused(text: str, said: list[str]) -> None:
    attribute = Attribute(LONG | SIGNED | 4 << 24)
    with pytest.raises(UsageError) as caught:
        attribute.encode(text)
    names(caught.value, *said)
    assert attribute.encode("214748.36470") == struct.pack("<i", (1 << 31) - 1)
    assert attribute.text(struct.pack("<i", 1)) == "0.0001"


def test_what_the_exchange_owns_is_not_written_over_the_mailbox() -> None:
    position = Idn("Position feedback", LONG | SIGNED | READ_ONLY, bytes(4))
    target = Idn("Position command", LONG | SIGNED, bytes(4), in_mdt=True)
    idns = {"S-0-0051": position, "S-0-0047": target}
    for state, name, code in (
        (AlState.PREOP, "S-0-0051", "0x7004"),
        (AlState.OP, "S-0-0051", "0x7004"),
        (AlState.SAFEOP, "S-0-0047", "0x700A"),
        (AlState.OP, "S-0-0047", "0x700A"),
    ):
        with pytest.raises(StateError) as caught:
            run(write_idn(served(idns, state), 0, parse_idn(name), bytes(4), is_list=False))
        names(caught.value, f"SoE error {code}")
    run(write_idn(served(idns, AlState.PREOP), 0, 47, b"\1\0\0\0", is_list=False))
    assert target.value == b"\1\0\0\0"


@given(st.binary(max_size=60), st.integers(0, 0x7F))
def test_any_answer_is_decoded_or_refused(data: bytes, elements: int) -> None:
    try:
        _, attribute, _, value = split_elements(data, Element(elements))
    except StateError:
        return
    attribute.decode(value)
