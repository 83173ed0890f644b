"""PDO mapping and assignment by a master, in the procedure of CiA 301."""

import struct

import pytest
from slave_bench import ACK, ERROR, PREOP, SAFEOP, Bench

from ecatd.base.errors import SdoAbortError
from ecatd.etg import error_codes
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo
from ecatsim import Access, Device, Mailbox


class Variable(Device):
    """Writable mapping and assignment; objects of several types to map."""

    order = "Variable"
    mailbox = Mailbox(receive_size=256, send=0x1100, send_size=256, coe_details=0x2F)
    variable_assignment = True
    variable_mapping = True
    mapping_limits = (16, 16)
    rx_pdos = (
        Pdo(0x1600, "Out", 2, [Entry(0x7000, 1, "Word", DataType.UNSIGNED16, 16)]),
        Pdo(0x1601, "More", 0xFF, [Entry(0x7000, 2, "Byte", DataType.UNSIGNED8, 8)]),
    )
    tx_pdos = (Pdo(0x1A00, "In", 3, [Entry(0x6000, 1, "Word", DataType.UNSIGNED16, 16)]),)

    def describe(self):
        add = self.dictionary.variable
        add(0x7010, "Real", DataType.REAL32, 0.0, Access.RW | Access.RX_PDO)
        add(0x7011, "Signed", DataType.INTEGER8, 0, Access.RW | Access.RX_PDO)
        add(0x6010, "Real", DataType.REAL32, 1.5, Access.RO | Access.TX_PDO)
        add(0x6011, "Bit", DataType.BOOLEAN, 1, Access.RO | Access.TX_PDO)
        add(0x2000, "Parameter", DataType.UNSIGNED16, 0, Access.RW)


class Half(Variable):
    """Only one PDO can be mapped."""

    variable_mapping = (0x1601,)
    variable_assignment = False


def mapped(*entries):
    return [index << 16 | subindex << 8 | bits for index, subindex, bits in entries]


def set_list(bench, index, values, layout="<I"):
    bench.download(index, 0, b"\0")
    for number, value in enumerate(values, 1):
        bench.download(index, number, struct.pack(layout, value))
    bench.download(index, 0, bytes([len(values)]))


def code(function, *arguments, **options):
    with pytest.raises(SdoAbortError) as caught:
        function(*arguments, **options)
    return caught.value.code


def test_mapping_changes_the_process_data():
    bench = Bench(Variable()).preop()
    outputs = mapped((0x7010, 0, 32), (0, 0, 4), (0x7011, 0, 8))
    set_list(bench, 0x1600, outputs)
    set_list(bench, 0x1A00, mapped((0x6011, 0, 1), (0, 0, 7), (0x6010, 0, 32)))
    bench.set_process_data()
    assert bench.request(SAFEOP) == (PREOP | ERROR, 0x1D), "44 bits are 6 bytes, not 2"
    bench.set_process_data(outputs=6, inputs=2)
    assert bench.request(SAFEOP | ACK) == (PREOP | ERROR, 0x1E), "40 bits are 5 bytes, not 2"
    bench.set_process_data(outputs=6, inputs=5)
    assert bench.request(SAFEOP | ACK) == (SAFEOP, 0)
    image = int.from_bytes(struct.pack("<f", -2.5), "little") | (-3 & 0xFF) << 36
    bench.op(image.to_bytes(6, "little")).run()
    assert bench.device.dictionary[0x7010, 0].value == -2.5
    assert bench.device.dictionary[0x7011, 0].value == -3
    assert bench.get() == b"\1" + struct.pack("<f", 1.5)


def test_assignment_changes_the_process_data():
    bench = Bench(Variable()).preop()
    set_list(bench, 0x1C12, [0x1601, 0x1600], "<H")
    bench.set_process_data(outputs=3)
    assert bench.request(SAFEOP) == (SAFEOP, 0)
    bench.op(b"\x07\x34\x12").run()
    assert bench.device[0x7000, 2] == 7
    assert bench.device[0x7000, 1] == 0x1234


def test_nothing_assigned():
    bench = Bench(Variable()).preop()
    set_list(bench, 0x1C12, [], "<H")
    bench.set_process_data(outputs=0)
    assert bench.request(SAFEOP) == (SAFEOP, 0)


def test_the_old_mapping_is_gone_with_the_0_in_entry_0():
    bench = Bench(Variable()).preop()
    bench.download(0x1600, 0, b"\0")
    bench.set_process_data()
    assert bench.request(SAFEOP) == (PREOP | ERROR, 0x1D)
    bench.set_process_data(outputs=0)
    assert bench.request(SAFEOP | ACK) == (SAFEOP, 0)


def test_complete_access():
    bench = Bench(Variable()).preop()
    values = mapped((0x7011, 0, 8), (0x7000, 1, 16))
    bench.download(0x1600, 0, struct.pack("<H2I", 2, *values), complete=True)
    assert bench.upload(0x1600, 0) == b"\2"
    assert bench.upload(0x1600, 0, complete=True)[:10] == struct.pack("<H2I", 2, *values)
    bench.download(0x1C12, 0, struct.pack("<HHH", 2, 0x1600, 0x1601), complete=True)
    bench.set_process_data(outputs=4)
    assert bench.request(SAFEOP) == (SAFEOP, 0)


def test_refused_complete_access_changes_nothing():
    bench = Bench(Variable()).preop()
    before = bench.upload(0x1600, 0, complete=True)
    wrong = struct.pack("<H2I", 2, *mapped((0x7011, 0, 8), (0x2000, 0, 16)))
    assert code(bench.download, 0x1600, 0, wrong, True) == error_codes.NOT_MAPPABLE
    assert bench.upload(0x1600, 0, complete=True) == before


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        ((0x2000, 0, 16), error_codes.NOT_MAPPABLE),  # a parameter
        ((0x6010, 0, 32), error_codes.NOT_MAPPABLE),  # an input
        ((0x7011, 0, 16), error_codes.NOT_MAPPABLE),  # another length
        ((0, 0, 0), None),  # means an empty entry
        ((0, 1, 8), error_codes.NOT_MAPPABLE),
        ((0x5000, 0, 8), error_codes.NO_OBJECT),
        ((0x7000, 9, 8), error_codes.NO_SUBINDEX),
    ],
)
def test_what_cannot_be_mapped(entry, expected):
    bench = Bench(Variable()).preop()
    bench.download(0x1600, 0, b"\0")
    (value,) = mapped(entry)
    if expected is None:
        bench.download(0x1600, 1, struct.pack("<I", value))
        assert code(bench.download, 0x1600, 0, b"\1") == error_codes.NOT_MAPPABLE
    else:
        assert code(bench.download, 0x1600, 1, struct.pack("<I", value)) == expected


def test_mapping_that_is_too_long():
    bench = Bench(Variable()).preop()
    words = mapped(*[(0x7010, 0, 32)] * 5)
    assert code(set_list, bench, 0x1600, words) == error_codes.PDO_LENGTH
    assert bench.upload(0x1600, 0) == b"\0"
    set_list(bench, 0x1600, words[:4])


def test_assignment_that_is_too_long():
    bench = Bench(Variable()).preop()
    set_list(bench, 0x1600, mapped(*[(0x7010, 0, 32)] * 4))
    assert code(set_list, bench, 0x1C12, [0x1600, 0x1601], "<H") == error_codes.PDO_LENGTH


@pytest.mark.parametrize(("index", "al_code"), [(0x1600, 0x25), (0x1A00, 0x24)])
def test_mapping_that_grew_after_the_assignment(index, al_code):
    class Two(Variable):
        tx_pdos = (*Variable.tx_pdos, Pdo(0x1A01, "More", 3, [Entry(0x6000, 2, "Byte", 5, 8)]))
        rx_pdos = (Variable.rx_pdos[0], Pdo(0x1601, "More", 2, [Entry(0x7000, 2, "Byte", 5, 8)]))

    bench = Bench(Two()).preop()
    real = 0x7010 if index == 0x1600 else 0x6010
    set_list(bench, index, mapped(*[(real, 0, 32)] * 4))
    bench.set_process_data()
    assert bench.request(SAFEOP) == (PREOP | ERROR, al_code)


def test_entries_are_written_while_entry_0_is_0():
    bench = Bench(Variable()).preop()
    (value,) = mapped((0x7011, 0, 8))
    assert code(bench.download, 0x1600, 1, struct.pack("<I", value)) == error_codes.COUNT_NOT_ZERO
    assert code(bench.download, 0x1C12, 1, b"\x01\x16") == error_codes.COUNT_NOT_ZERO
    assert code(bench.download, 0x1600, 0, b"\xff") == error_codes.VALUE_TOO_HIGH


@pytest.mark.parametrize("pdos", [[0x1600, 0x1600], [0x1602], [0x1A00]])
def test_wrong_assignments(pdos):
    bench = Bench(Variable()).preop()
    assert code(set_list, bench, 0x1C12, pdos, "<H") == error_codes.VALUE_RANGE


def test_mapping_and_assignment_are_fixed_outside_preop():
    bench = Bench(Variable()).safeop()
    for index in (0x1600, 0x1A00, 0x1C12, 0x1C13):
        assert code(bench.download, index, 0, b"\0") == error_codes.DEVICE_STATE
    bench.request(PREOP)
    bench.download(0x1600, 0, b"\0")


def test_only_what_is_variable_can_be_written():
    bench = Bench(Half()).preop()
    bench.download(0x1601, 0, b"\0")
    assert code(bench.download, 0x1600, 0, b"\0") == error_codes.READ_ONLY
    assert code(bench.download, 0x1C12, 0, b"\0") == error_codes.READ_ONLY
    whole = struct.pack("<HH", 1, 0x1600)
    assert code(bench.download, 0x1C12, 0, whole, True) == error_codes.READ_ONLY


def test_reset_brings_the_default_mapping_back():
    bench = Bench(Variable()).preop()
    set_list(bench, 0x1600, mapped((0x7011, 0, 8)))
    bench.set_process_data(outputs=1)
    assert bench.request(SAFEOP) == (SAFEOP, 0)
    bench.device.reset()
    bench.safeop().op(b"\x34\x12").run()
    assert bench.device[0x7000, 1] == 0x1234


def test_mappings_of_neighbours_stay_apart():
    first, second = Variable(), Variable()
    bench = Bench(first, second).preop()
    set_list(bench, 0x1600, mapped(*[(0x7010, 0, 32)] * 4))
    bench.set_process_data(outputs=16)
    assert bench.request(SAFEOP) == (SAFEOP, 0)
    bench.op(struct.pack("<4f", 1, 2, 3, 4)).run()
    assert first.dictionary[0x7010, 0].value == 4
    assert first.room == (16, 16)
    assert second.dictionary[0x7010, 0].value == 0
