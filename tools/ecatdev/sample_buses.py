"""Sample buses for checks of the generator, as a daemon with our device profiles describes them."""

from __future__ import annotations

from ecatd.config.meanings import give_meanings
from ecatd.config.profiles import load_profiles
from ecatd.description.bus import Bus, Slave
from ecatd.etg.datatypes import DataType
from ecatd.etg.pdo import Entry, Pdo

_BECKHOFF = 0x00000002
_GAP8 = Entry(0, 0, "", DataType.PADDING, 8)

AWKWARD_TEXTS = (
    'He said "hi"',
    "model",
    "",
    "Größe 5 µm",
    "1st/../../x",
    "</html>",
    "x" * 200,
    "end when;",
    "half \ud800",
    "日本語",
    "%name %class",
    "??/ trigraph */ /*",
    "ends with \\",
    "Real",
    "EtherCAT",
    "UsersGuide",
    "reference",
    "switch",
    "a\x00b\nc\u2028d",
    "EL1018 A",
    "el1018 B",
)
"""Names of slaves and entries that cannot be used as they are in Modelica, C, HTML or paths."""


def troll() -> Bus:
    """Returns the reference plant: a drive, a coupler, digital, analog and CANopen terminals."""
    return give_meanings(
        Bus(
            "ecat0",
            1000,
            [
                _drive(0),
                Slave(1, "EK1100", _BECKHOFF, 0x044C2C52, 0x00120000),
                _digital(2, "EL1018", 0x03FA3052, outputs=False),
                _digital(3, "EL2008", 0x07D83052, outputs=True),
                _analog(4),
                _analog(5),
                Slave(6, "EL6751", _BECKHOFF, 0x1A5F3052, 0x00140000, coe=True),
                Slave(7, "EL6751", _BECKHOFF, 0x1A5F3052, 0x00140000, coe=True),
            ],
        ),
        load_profiles(),
    )


def awkward() -> Bus:
    """Returns a bus with awkward names, entries of all kinds, and numbers too large for Integer."""
    return give_meanings(
        Bus(
            'a"b',
            250,
            [_awkward_slave(position, text) for position, text in enumerate(AWKWARD_TEXTS)],
        ),
        load_profiles(),
    )


def axes() -> Bus:
    """Returns a bus of drives: two lack usual entries, one has more than the state machine uses."""
    i16, i32, u8 = DataType.INTEGER16, DataType.INTEGER32, DataType.UNSIGNED8
    u16, u32 = DataType.UNSIGNED16, DataType.UNSIGNED32
    control = Entry(0x6040, 0, "Controlword", u16, 16)
    status = Entry(0x6041, 0, "Statusword", u16, 16)
    position = [
        [control, Entry(0x607A, 0, "Target position", i32, 32)],
        [status, Entry(0x6064, 0, "Position actual value", i32, 32)],
    ]
    torque = [
        [control, Entry(0x6071, 0, "Target torque", i16, 16)],
        [status, Entry(0x6078, 0, "Current actual value", i16, 16)],
    ]
    rich = [
        [
            *(control, Entry(0x60FF, 0, "Target velocity", i32, 32)),
            *(Entry(0x6081, 0, "Profile velocity", u32, 32), Entry(0x7000, 1, "Brake", u8, 1)),
            Entry(0x6060, 0, "Modes of operation", DataType.INTEGER8, 8),
        ],
        [status, Entry(0x606C, 0, "Velocity actual value", i32, 32)],
    ]
    return give_meanings(
        Bus(
            "axes",
            1000,
            [
                Slave(
                    n,
                    name,
                    0x0000FFFF,
                    0x402 + n,
                    1,
                    coe=True,
                    outputs=[Pdo(0x1600, "Outputs", 2, outputs)],
                    inputs=[Pdo(0x1A00, "Inputs", 3, inputs)],
                )
                for n, (name, (outputs, inputs)) in enumerate(
                    {"Position axis": position, "Torque axis": torque, "Rich axis": rich}.items()
                )
            ],
        ),
        load_profiles(),
    )


def empty() -> Bus:
    """Returns a bus without slaves."""
    return Bus("ecat0", 1000, [])


ALL = {"troll": troll, "awkward": awkward, "axes": axes, "empty": empty}
"""Functions that make the sample buses, by name."""


def _drive(position: int) -> Slave:
    i8, i16, i32 = DataType.INTEGER8, DataType.INTEGER16, DataType.INTEGER32
    u16 = DataType.UNSIGNED16
    outputs = [
        Entry(0x607A, 0, "Target Position", i32, 32),
        Entry(0x60FF, 0, "Target Velocity", i32, 32),
        Entry(0x6071, 0, "Target Torque", i16, 16),
        Entry(0x6072, 0, "Max. Torque", u16, 16),
        Entry(0x6040, 0, "Control word", u16, 16),
        Entry(0x6060, 0, "Mode of operation", i8, 8),
        _GAP8,
    ]
    inputs = [
        Entry(0x6064, 0, "Position actual value", i32, 32),
        Entry(0x6077, 0, "Torque value", i16, 16),
        Entry(0x6041, 0, "Status word", u16, 16),
        Entry(0x6061, 0, "Mode of operation display", i8, 8),
        _GAP8,
    ]
    speed = Entry(0x606C, 0, "Velocity actual value", i32, 32)
    current = Entry(0x6078, 0, "Current actual value", i16, 16)
    return Slave(
        position,
        "Gold EtherCAT GCON Drive",
        0x0000009A,
        0x00030924,
        0x00010420,
        coe=True,
        outputs=[Pdo(0x1605, "RPDO6 Mapping", 2, outputs)],
        inputs=[
            Pdo(0x1A02, "TPDO3 Mapping", 3, inputs),
            Pdo(0x1A11, "Velocity actual value", 3, [speed]),
            Pdo(0x1A1F, "Current actual value", 3, [current]),
        ],
    )


def _digital(position: int, name: str, product: int, *, outputs: bool) -> Slave:
    base, mapping = (0x7000, 0x1600) if outputs else (0x6000, 0x1A00)
    text = "Output" if outputs else "Input"
    pdos = [
        Pdo(
            mapping + n,
            f"Channel {n + 1}",
            0,
            [Entry(base + 16 * n, 1, text, DataType.BOOLEAN, 1)],
        )
        for n in range(8)
    ]
    slave = Slave(position, name, _BECKHOFF, product, 0x00100000)
    if outputs:
        slave.outputs = pdos
    else:
        slave.inputs = pdos
    return slave


def _analog(position: int) -> Slave:
    pdos = []
    for n in range(8):
        index = 0x6000 + 16 * n
        entries = [
            Entry(index, 0x01, "Status__Underrange", DataType.BOOLEAN, 1),
            Entry(index, 0x02, "Status__Overrange", DataType.BOOLEAN, 1),
            Entry(index, 0x03, "Status__Limit 1", DataType.BIT2, 2),
            Entry(index, 0x05, "Status__Limit 2", DataType.BIT2, 2),
            Entry(index, 0x07, "Status__Error", DataType.BOOLEAN, 1),
            Entry(0, 0, "", DataType.PADDING, 7),
            Entry(index, 0x0F, "Status__TxPDO State", DataType.BOOLEAN, 1),
            Entry(index, 0x10, "Status__TxPDO Toggle", DataType.BOOLEAN, 1),
            Entry(index, 0x11, "Value", DataType.INTEGER16, 16, "V", 10 / 32767),
        ]
        pdos.append(Pdo(0x1A00 + 2 * n, f"AI Standard Channel {n + 1}", 3, entries))
    return Slave(position, "EL3008", _BECKHOFF, 0x0BC03052, 0x00140000, coe=True, inputs=pdos)


def _awkward_slave(position: int, text: str) -> Slave:
    texts = ["", "for", text, text, "time", "committed", "written 7000 01", "default"]
    outputs = [
        *(Entry(0x7000, n, name, DataType.UNSIGNED8, 8) for n, name in enumerate(texts, 1)),
        Entry(0x7001, 1, text, DataType.UNSIGNED64, 64),
        Entry(0x7001, 2, "single", DataType.REAL32, 32),
        Entry(0x7001, 2, "the same again", DataType.REAL32, 32),
    ]
    inputs = [
        Entry(0x6000, 1, text, DataType.UNSIGNED64, 64),
        Entry(0x6000, 2, text, DataType.UNSIGNED32, 32),
        Entry(0x6000, 3, text, DataType.REAL64, 64),
        Entry(0x6000, 4, text, DataType.OCTET_STRING, 128),
        Entry(0x6000, 5, text, DataType.BOOLEAN, 8),
        Entry(0x6000, 6, text, DataType.DWORD, 31),
    ]
    return Slave(
        position,
        text,
        0xFFFF0000 + position,
        0x80000000,
        0xFFFFFFFF,
        outputs=[Pdo(0x1600, text, 2, outputs)],
        inputs=[Pdo(0x1A00, text, 3, inputs)],
    )
