"""CoE server, request by request."""

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from conftest import naming
from ecatd.base.errors import SdoAbortError, UsageError
from ecatd.etg import error_codes, unit_codes
from ecatd.etg.datatypes import DataType
from ecatsim.slave.coe import CoeServer
from ecatsim.slave.mailbox import MailboxServer, Protocol
from ecatsim.slave.objects import Access, Dictionary, ObjectCode, Variable

REPLY_SIZE = 48
PREOP, OP = 2, 8
LONG = bytes(range(200))


def dictionary():
    objects = Dictionary()
    objects.variable(0x2000, "Small", DataType.INTEGER16, -2, Access.RW)
    objects.variable(0x2001, "Text", DataType.VISIBLE_STRING, "hello world")
    objects.variable(0x2002, "Long", DataType.OCTET_STRING, LONG, Access.RW, bits=8 * 300)
    objects.variable(0x2003, "Secret", DataType.UNSIGNED8, 1, Access.WO)
    objects.variable(0x2004, "Set-up", DataType.UNSIGNED8, 1, Access.READ | Access.WRITE_PREOP)
    objects.variable(0x2005, "Bit", DataType.BOOLEAN, 0, Access.RW)
    objects.variable(0x2006, "Real", DataType.REAL32, 1.5, Access.RW)
    limited = objects.variable(0x2007, "Limited", DataType.INTEGER8, 0, Access.RW)
    limited.minimum, limited.maximum = -5, 5
    objects.array(0x2010, "Row", DataType.UNSIGNED16, [1, 2, 3], Access.RW)
    objects.record(
        0x2020,
        "Mixed",
        [
            Variable(0x2020, 1, "Flag", DataType.BOOLEAN, access=Access.RW, value=1),
            Variable(0x2020, 2, "Two bits", DataType.BIT2, access=Access.RW, value=2),
            Variable(0x2020, 3, "Rest", DataType.UNSIGNED8, 5, Access.RO, 0x15),
            Variable(0x2020, 4, "Number", DataType.INTEGER16, access=Access.RW, value=-1),
        ],
    )
    return objects


class Client:
    """A master's side of the protocol, written against the standard and not against the server."""

    def __init__(self, state=PREOP, complete_access=True):
        self.objects = dictionary()
        self.server = CoeServer(
            self.objects, lambda: state, REPLY_SIZE, complete_access=complete_access
        )

    def sdo(self, request):
        (reply,) = self.server.handle(struct.pack("<H", 2 << 12) + request)
        service = struct.unpack_from("<H", reply)[0] >> 12
        if reply[2] == 0x80:
            assert service == 2, "an abort is an SDO request"
            raise SdoAbortError(struct.unpack_from("<I", reply, 6)[0])
        assert service == 3
        return reply[2:]

    def upload(self, index, subindex, complete=False):
        reply = self.sdo(struct.pack("<BHBI", 0x40 | complete << 4, index, subindex, 0))
        assert struct.unpack_from("<HB", reply, 1) == (index, subindex)
        assert bool(reply[0] & 0x10) == complete
        if reply[0] & 0x02:
            return reply[4 : 8 - (reply[0] >> 2 & 3)]
        size = struct.unpack_from("<I", reply, 4)[0]
        data, toggle, last = reply[8:], 0, False
        while len(data) < size and not last:
            reply = self.sdo(struct.pack("<B7x", 0x60 | toggle << 4))
            assert reply[0] >> 4 & 1 == toggle
            last = bool(reply[0] & 1)
            data += reply[1 : len(reply) - (reply[0] >> 1 & 7)]
            toggle ^= 1
        assert len(data) == size
        return data

    def download(self, index, subindex, data, complete=False, first=12, segment=20):
        bits = 0x20 | complete << 4
        if len(data) <= 4:
            bits |= 0x03 | (4 - len(data)) << 2
            self.sdo(struct.pack("<BHB", bits, index, subindex) + data.ljust(4, b"\0"))
            return
        head = struct.pack("<BHBI", bits | 0x01, index, subindex, len(data))
        self.sdo(head + data[:first])
        rest, toggle = data[first:], 0
        while rest:
            part, rest = rest[:segment], rest[segment:]
            unused = max(0, 7 - len(part))
            command = toggle << 4 | unused << 1 | (not rest)
            reply = self.sdo(bytes([command]) + part.ljust(7, b"\0"))
            assert reply[0] == 0x20 | toggle << 4
            toggle ^= 1

    def information(self, opcode, payload):
        request = struct.pack("<HBBH", 8 << 12, opcode, 0, 0) + payload
        replies = self.server.handle(request)
        left = len(replies)
        body = b""
        for reply in replies:
            left -= 1
            code, _, fragments = struct.unpack_from("<BBH", reply, 2)
            assert fragments == left
            assert bool(code & 0x80) == bool(left)
            assert len(reply) <= REPLY_SIZE - 6
            body += reply[6:]
            answer = code & 0x7F
        if answer == 7:
            raise SdoAbortError(struct.unpack("<I", body)[0])
        assert answer == opcode + 1
        return body


def code(function, *arguments, **options):
    with pytest.raises(SdoAbortError) as caught:
        function(*arguments, **options)
    return caught.value.code


@pytest.mark.parametrize(
    ("index", "subindex", "data"),
    [
        (0x2000, 0, b"\xfe\xff"),
        (0x2001, 0, b"hello world"),
        (0x2002, 0, LONG),
        (0x2005, 0, b"\0"),
        (0x2006, 0, struct.pack("<f", 1.5)),
        (0x2010, 0, b"\3"),
        (0x2010, 3, b"\3\0"),
        (0x2020, 3, b"\x15"),
    ],
)
def test_upload(index, subindex, data):
    assert Client().upload(index, subindex) == data


@pytest.mark.parametrize("length", [5, 9, 12, 13, 19, 20, 32, 33, 38, 39, 40, 200, 300])
def test_download_and_upload_of_every_length(length):
    client, data = Client(OP), bytes(i & 0xFF for i in range(length))
    client.download(0x2002, 0, data)
    assert client.upload(0x2002, 0) == data


def test_download():
    client = Client()
    client.download(0x2000, 0, b"\x00\x80")
    assert client.objects[0x2000, 0].value == -32768
    client.download(0x2005, 0, b"\1")
    assert client.objects[0x2005, 0].value == 1
    client.download(0x2006, 0, struct.pack("<f", -0.5))
    assert client.objects[0x2006, 0].value == -0.5


def test_abort_codes():
    client = Client()
    assert code(client.upload, 0x3000, 0) == error_codes.NO_OBJECT
    assert code(client.upload, 0x2010, 9) == error_codes.NO_SUBINDEX
    assert code(client.upload, 0x2003, 0) == error_codes.WRITE_ONLY
    assert code(client.download, 0x2001, 0, b"x") == error_codes.READ_ONLY
    assert code(client.download, 0x2000, 0, b"abcd") == error_codes.LENGTH_TOO_HIGH
    assert code(client.download, 0x2000, 0, b"a") == error_codes.LENGTH_TOO_LOW
    assert code(client.download, 0x2005, 0, b"\2") == error_codes.VALUE_RANGE
    assert code(client.download, 0x2007, 0, b"\6") == error_codes.VALUE_TOO_HIGH
    assert code(client.download, 0x2007, 0, b"\xfa") == error_codes.VALUE_TOO_LOW
    assert code(client.download, 0x2002, 0, bytes(301)) == error_codes.LENGTH_TOO_HIGH
    assert code(client.sdo, b"\xe0" + bytes(7)) == error_codes.INVALID_COMMAND
    assert code(client.sdo, b"\x60" + bytes(7)) == error_codes.INVALID_COMMAND
    assert client.upload(0x2000, 0) == b"\xfe\xff", "nothing has changed"


def test_state_decides_what_may_be_written():
    Client(PREOP).download(0x2004, 0, b"\7")
    assert code(Client(OP).download, 0x2004, 0, b"\7") == error_codes.DEVICE_STATE


def test_wrong_toggle_ends_the_transfer():
    client = Client()
    client.sdo(struct.pack("<BHBI", 0x40, 0x2002, 0, 0))
    assert code(client.sdo, struct.pack("<B7x", 0x70)) == error_codes.TOGGLE
    assert code(client.sdo, struct.pack("<B7x", 0x60)) == error_codes.INVALID_COMMAND


def test_too_short_segmented_download_changes_nothing():
    client = Client()
    client.sdo(struct.pack("<BHBI", 0x21, 0x2002, 0, 30))
    assert code(client.sdo, b"\x01" + bytes(20)) == error_codes.LENGTH_TOO_LOW
    assert client.upload(0x2002, 0) == LONG


def test_master_aborts_a_transfer():
    client = Client()
    client.sdo(struct.pack("<BHBI", 0x40, 0x2002, 0, 0))
    assert client.server.handle(struct.pack("<HBHBI", 2 << 12, 0x80, 0x2002, 0, 0)) == []
    assert code(client.sdo, struct.pack("<B7x", 0x60)) == error_codes.INVALID_COMMAND


def test_complete_access():
    client = Client()
    assert client.upload(0x2010, 0, True) == struct.pack("<BxHHH", 3, 1, 2, 3)
    assert client.upload(0x2010, 1, True) == struct.pack("<HHH", 1, 2, 3)
    assert client.upload(0x2020, 1, True) == bytes([1 | 2 << 1 | 0x15 << 3]) + b"\xff\xff"
    client.download(0x2010, 1, struct.pack("<HHH", 7, 8, 9), True)
    assert [client.objects[0x2010, i].value for i in (1, 2, 3)] == [7, 8, 9]
    client.download(0x2020, 1, b"\x00\x10\x00", True)
    assert [client.objects[0x2020, i].value for i in (1, 2, 3, 4)] == [0, 0, 0x15, 0x10]


def test_complete_access_is_refused_where_it_is_impossible():
    client = Client()
    assert code(client.upload, 0x2000, 0, True) == error_codes.NO_COMPLETE_ACCESS
    assert code(client.upload, 0x2010, 2, True) == error_codes.NO_COMPLETE_ACCESS
    client = Client(complete_access=False)
    assert code(client.upload, 0x2010, 0, True) == error_codes.NO_COMPLETE_ACCESS


def test_object_lists():
    client = Client()
    kind, *lengths = struct.unpack("<6H", client.information(1, struct.pack("<H", 0)))
    assert (kind, lengths) == (0, [10, 0, 0, 0, 0])
    kind, *indices = struct.unpack("<11H", client.information(1, struct.pack("<H", 1)))
    assert indices == [*range(0x2000, 0x2008), 0x2010, 0x2020]
    assert code(client.information, 1, struct.pack("<H", 9)) == error_codes.UNSUPPORTED_ACCESS


def test_object_and_entry_descriptions():
    client = Client()
    body = client.information(3, struct.pack("<H", 0x2020))
    assert struct.unpack_from("<HHBB", body) == (0x2020, 0, 4, ObjectCode.RECORD)
    assert body[6:] == b"Mixed"
    body = client.information(5, struct.pack("<HBB", 0x2020, 2, 0))
    assert struct.unpack_from("<HBBHHH", body) == (0x2020, 2, 0, 0x31, 2, 0x3F)
    assert body[10:] == b"Two bits"
    assert code(client.information, 3, struct.pack("<H", 0x9999)) == error_codes.NO_OBJECT
    assert code(client.information, 5, struct.pack("<HB", 0x2020, 9)) == error_codes.NO_SUBINDEX
    assert code(client.information, 9, b"") == error_codes.UNSUPPORTED_ACCESS


# --- what the optional parts of a description say ------------------------------------------


def entry_description(client, index, subindex, wanted):
    """Value info, the optional parts and the name."""
    body = client.information(5, struct.pack("<HBB", index, subindex, wanted))
    return body[3], body[10:]


def described():
    client = Client()
    entry = client.objects[0x2000, 0]
    entry.unit, entry.minimum, entry.maximum = unit_codes.code("mV"), -300, 300
    client.objects.remember()
    entry.value = 77
    return client


def test_unit_default_minimum_and_maximum():
    client = described()
    given, rest = entry_description(client, 0x2000, 0, 0x7F)
    assert given == 0x7F
    assert struct.unpack_from("<IhhhI", rest[:10] + bytes(4)) == (0xFD260000, -2, -300, 300, 0)
    assert rest[10:] == b"Small"
    client.objects[0x2000, 0].default = 5
    assert entry_description(client, 0x2000, 0, 0x10)[1] == b"\x05\0Small"


def test_only_wanted_and_existing_parts_are_given():
    client = described()
    assert entry_description(client, 0x2000, 0, 0x40) == (0x40, struct.pack("<h", 300) + b"Small")
    given, rest = entry_description(client, 0x2006, 0, 0x78)
    assert (given, rest) == (0x18, bytes(4) + struct.pack("<f", 1.5) + b"Real")
    given, rest = entry_description(client, 0x2001, 0, 0x10)
    assert (given, rest) == (0x10, b"hello worldText")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", 0),
        ("V", 0x00260000),
        ("mV", 0xFD260000),
        ("m", 0x00010000),
        ("mm", 0xFD010000),
        ("m/s", 0x00010300),
        ("rpm", 0x00B44700),
        ("rev/min", 0x00B44700),
        ("inc/s", 0x00B50300),
        ("kHz", 0x03200000),
        ("µA", 0xFA040000),
        ("kg", 0x00020000),
        ("1/s", 0x00000300),
    ],
)
def test_unit_codes(text, expected):
    assert unit_codes.code(text) == expected


def test_unknown_units():
    for text in ("parsec", "m/parsec", "/s", "kk"):
        with pytest.raises(UsageError, match=naming(f"'{text}'", "unit")):
            unit_codes.code(text)
        assert unit_codes.known(text) == 0


def test_lists_of_mappable_and_stored_objects():
    client = Client()
    add = client.objects.variable
    add(0x6000, "In", DataType.UNSIGNED8, access=Access.RO | Access.TX_PDO)
    add(0x7000, "Out", DataType.UNSIGNED8, access=Access.RW | Access.RX_PDO)
    add(0x8000, "Stored", DataType.UNSIGNED8, access=Access.RW | Access.BACKUP | Access.SETTING)
    found = [client.information(1, struct.pack("<H", kind)) for kind in range(6)]
    assert struct.unpack("<6H", found[0]) == (0, 13, 1, 1, 1, 1)
    assert [struct.unpack("<HH", body) for body in found[2:]] == [
        (2, 0x7000),
        (3, 0x6000),
        (4, 0x8000),
        (5, 0x8000),
    ]
    rights = client.information(5, struct.pack("<HBB", 0x8000, 0, 0))
    assert struct.unpack_from("<H", rights, 8)[0] == 0x33F


# --- less usual requests -------------------------------------------------------------------


def test_expedited_download_that_does_not_say_its_length():
    client = Client()
    client.sdo(struct.pack("<BHBI", 0x22, 0x2000, 0, 0x1234))
    assert client.objects[0x2000, 0].value == 0x1234


def test_reading_in_a_state_in_which_it_is_not_allowed():
    client = Client(OP)
    client.objects[0x2000, 0].access = Access(0x01)
    assert code(client.upload, 0x2000, 0) == error_codes.DEVICE_STATE
    assert code(Client(4).download, 0x2004, 0, b"\7") == error_codes.DEVICE_STATE


def test_another_request_ends_a_transfer():
    client = Client()
    client.sdo(struct.pack("<BHBI", 0x21, 0x2002, 0, 30) + bytes(12))
    assert client.upload(0x2000, 0) == b"\xfe\xff"
    assert code(client.sdo, b"\x01" + bytes(18)) == error_codes.INVALID_COMMAND
    assert client.upload(0x2002, 0) == LONG


def test_segmented_download_with_too_much_data():
    client = Client()
    client.sdo(struct.pack("<BHBI", 0x21, 0x2002, 0, 20))
    assert code(client.sdo, b"\x00" + bytes(21)) == error_codes.LENGTH_TOO_HIGH
    assert code(client.sdo, b"\x11" + bytes(20)) == error_codes.INVALID_COMMAND


def test_master_aborts_a_download():
    client = Client()
    client.sdo(struct.pack("<BHBI", 0x21, 0x2002, 0, 20))
    assert client.server.handle(struct.pack("<HBHBI", 2 << 12, 0x80, 0x2002, 0, 0)) == []
    assert code(client.sdo, b"\x01" + bytes(20)) == error_codes.INVALID_COMMAND


def test_long_complete_access_is_segmented():
    client = Client()
    client.objects.array(0x3000, "Long row", DataType.UNSIGNED16, range(100), Access.RW)
    expected = struct.pack("<H100H", 100, *range(100))
    assert client.upload(0x3000, 0, True) == expected
    client.download(0x3000, 1, struct.pack("<100H", *range(100, 200)), True)
    assert client.objects[0x3000, 100].value == 199
    whole = struct.pack("<101H", *range(101))
    assert code(client.download, 0x3000, 1, whole, True) == error_codes.LENGTH_TOO_HIGH


def test_refused_complete_access_changes_nothing():
    client = Client()
    client.objects[0x2010, 3].maximum = 5
    data = struct.pack("<HHH", 7, 8, 9)
    assert code(client.download, 0x2010, 1, data, True) == error_codes.VALUE_TOO_HIGH
    assert [client.objects[0x2010, i].value for i in (1, 2, 3)] == [1, 2, 3]


def test_complete_access_to_a_read_only_object():
    client = Client()
    client.objects.array(0x3000, "Fixed", DataType.UNSIGNED8, [1, 2])
    assert code(client.download, 0x3000, 1, b"\3\4", True) == error_codes.READ_ONLY


def test_limits_of_real_numbers():
    client = Client()
    client.objects[0x2006, 0].maximum = 2.5
    assert code(client.download, 0x2006, 0, struct.pack("<f", 3)) == error_codes.VALUE_TOO_HIGH
    client.download(0x2006, 0, struct.pack("<f", 2.5))


@settings(max_examples=300)
@given(st.lists(st.binary(max_size=64), max_size=8))
def test_no_mail_does_harm(mails):
    client = Client()
    server = MailboxServer({Protocol.COE: client.server.handle}, lambda mail, again: True)
    for mail in mails:
        server.receive(mail)
        for head in (b"\x00\x20", b"\x00\x80", b""):
            body = head + mail
            server.receive(struct.pack("<HHBB", len(body), 0, 0, Protocol.COE) + body)
            server.was_read()
    client.server.reset()
    assert client.upload(0x2001, 0) == b"hello world"
