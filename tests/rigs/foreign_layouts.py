"""Slaves whose EEPROMs are unusual, as those of real devices are; inputs follow outputs."""

from typing import Any

from ecatd.etg.sii_check import check_sii
from ecatsim import DataType, Entry, Pdo, Rig
from ecatsim.files.sii_image import DeviceFromSii, device_from_sii
from ecatsim.slave.sii import (
    DcMode,
    Description,
    FmmuType,
    Mailbox,
    SmType,
    SyncManager,
    build,
)

EMULATED_WITH_CLOCK = 0x0506  # word 0: device emulation, SYNC signals
VIRTUAL, ENABLED_IN_OP = 0x04, 0x09
NEXT_SYNC1 = 0x0998  # register

OUTPUTS, INPUTS = SmType.OUTPUTS, SmType.INPUTS


class Foreign(DeviceFromSii):
    """A device of an EEPROM; the input 0x6xxx is what came to the output 0x7xxx."""

    def __init__(self, order: str, product: int, **facts: Any) -> None:
        image = build(Description(0xFFFF, product, 1, order=order, name=order, **facts))
        device_from_sii(image, order)  # refuses what is damaged
        super().__init__(image, check_sii(image))

    def step(self, now: float) -> None:
        for pdo in self.tx_pdos:
            for entry in pdo.entries:
                if 0x6000 <= entry.index < 0x7000:
                    self[entry.index, entry.subindex] = self[entry.index + 0x1000, entry.subindex]


def samples(index: int, manager: int, objects: int) -> list[Pdo]:
    """PDOs of 53 bits: 16 samples, a state, a counter of cycles, and gaps of all sizes."""
    entries = [Entry(objects, n + 1, f"Sample {n}", DataType.BOOLEAN, 1) for n in range(16)]
    state = Entry(objects, 0x21, "State", DataType.BOOLEAN, 1)
    cycles = Entry(objects, 0x22, "Cycles", DataType.UNSIGNED8, 8)
    gaps = [
        Pdo(index + 0x10 + bits, f"Gap {bits}", manager, [Entry(0, 0, "", DataType.PADDING, bits)])
        for bits in range(1, 8)
    ]
    return [
        Pdo(index, "Samples", manager, entries),
        Pdo(index - 0x100, "State", manager, [state]),
        Pdo(index + 0x100, "Cycles", manager, [cycles]),
        *gaps,
    ]


def word(index: int, manager: int, entry: int, subindex: int, bits: int = 16) -> Pdo:
    kind = DataType.UNSIGNED32 if bits == 32 else DataType.UNSIGNED16
    return Pdo(index, f"Word {subindex}", manager, [Entry(entry, subindex, "Word", kind, bits)])


def oversampling(order: str, product: int, start: int, tx_pdos: list[Pdo]) -> Foreign:
    """As EL2262 is: two sync managers of outputs without a length, and a virtual one of inputs."""
    return Foreign(
        order,
        product,
        pdi_control=EMULATED_WITH_CLOCK,
        sync_managers=[
            SyncManager(OUTPUTS, 0x1000, 0, 0x64, ENABLED_IN_OP),
            SyncManager(OUTPUTS, 0x1200, 0, 0x64, ENABLED_IN_OP),
            SyncManager(INPUTS, start, 0, 0x00, VIRTUAL),
        ],
        fmmus=[FmmuType.OUTPUTS, FmmuType.OUTPUTS, FmmuType.INPUTS],
        rx_pdos=samples(0x1700, 0, 0x7000) + samples(0x1720, 1, 0x7010),
        tx_pdos=tx_pdos,
        dc_modes=[DcMode("Oversampling", 0x0700, sync1_cycle_factor=-1)],
    )


def follower(product: int) -> Foreign:
    """As above, but its inputs, also virtual, are memory and follow the outputs."""
    back = [
        Pdo(pdo.index + 0x80, pdo.name, 2, [_input(entry) for entry in pdo.entries])
        for pdo in (*samples(0x1700, 0, 0x7000)[:3], *samples(0x1720, 1, 0x7010)[:3])
    ]
    return oversampling("Follower", product, 0x1400, back)


def _input(entry: Entry) -> Entry:
    return Entry(
        entry.index - 0x1000, entry.subindex, entry.name, entry.data_type, entry.bit_length
    )


def backwards(product: int) -> Foreign:
    """Inputs before outputs, PDO indices of the other direction, usages that are not said."""
    return Foreign(
        "Backwards",
        product,
        sync_managers=[
            SyncManager(SmType.UNUSED, 0x1400, 200, 0x20, 0),
            SyncManager(SmType.UNUSED, 0x1000, 200, 0x64, 0),
        ],
        fmmus=[FmmuType.INPUTS, FmmuType.OUTPUTS],
        rx_pdos=[word(0x1A00, 1, 0x7000, 1), word(0x1A01, 1, 0x7000, 2)],
        tx_pdos=[word(0x1600, 0, 0x6000, 1), word(0x1601, 0, 0x6000, 2)],
    )


def processor(product: int) -> Foreign:
    """With a mailbox, without FMMUs, and with lengths of sync managers that are not its PDOs'."""
    return Foreign(
        "Processor",
        product,
        mailbox=Mailbox(),
        sync_managers=[
            SyncManager(SmType.MAILBOX_OUT, 0x1000, 128, 0x26),
            SyncManager(SmType.MAILBOX_IN, 0x1080, 128, 0x22),
            SyncManager(OUTPUTS, 0x1100, 200, 0x64, 0),
            SyncManager(INPUTS, 0x1D00, 1, 0x20, 0),
        ],
        rx_pdos=[word(0x1600, 2, 0x7000, 1), word(0x1601, 0xFF, 0x7000, 2)],
        tx_pdos=[word(0x1A00, 3, 0x6000, 1), word(0x1A01, 0xFF, 0x6000, 2)],
    )


def rig() -> Rig:
    clock = [word(0x1702, 2, 0x1D09, 0x98, 32)]
    return Rig(
        "foreign layouts",
        [
            oversampling("Oversampler", 0x20, NEXT_SYNC1, clock),
            follower(0x21),
            backwards(0x22),
            processor(0x23),
        ],
    )
