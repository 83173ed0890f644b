"""ENI files of our own: one of a whole machine, and the parts that others are made of."""

from collections.abc import Iterable


def command(register: int, data: str = "", *transitions: str, cmd: int = 5, more: str = "") -> str:
    """A register command of a slave."""
    return (
        f"<InitCmd>{_transitions(transitions or ('PS',))}<Comment>r</Comment><Cmd>{cmd}</Cmd>"
        f"<Adp>1001</Adp><Ado>{register}</Ado><Data>{data}</Data>{more}</InitCmd>"
    )


def coe(
    index: int,
    subindex: int,
    data: str,
    *transitions: str,
    ca: int = 0,
    ccs: int = 1,
    more: str = "",
) -> str:
    """A CoE command."""
    body = f"<Data>{data}</Data>" if data else ""
    return (
        f'<InitCmd CompleteAccess="{ca}">{_transitions(transitions or ("PS",))}'
        f"<Timeout>0</Timeout><Ccs>{ccs}</Ccs><Index>{index}</Index>"
        f"<SubIndex>{subindex}</SubIndex>{body}{more}</InitCmd>"
    )


def _transitions(names: Iterable[str]) -> str:
    return "".join(f"<Transition>{name}</Transition>" for name in names)


def fmmu(number: int, address: int, size: int, *, outputs: bool) -> str:
    """A command that sets an FMMU up."""
    data = address.to_bytes(4, "little") + size.to_bytes(2, "little") + bytes((0, 7, 0, 0x11, 0))
    return command(0x0600 + 16 * number, (data + bytes((2 if outputs else 1, 1, 0, 0, 0))).hex())


def slave(
    name: str,
    info: str,
    *,
    data: str = "",
    objects: str | None = None,
    registers: str = "",
    more: str = "",
) -> str:
    """A slave; with `objects` it has CoE."""
    mailbox = (
        ""
        if objects is None
        else "<Mailbox><Send><Start>4096</Start></Send><Protocol>CoE</Protocol>"
        f"<CoE><InitCmds>{objects}</InitCmds></CoE></Mailbox>"
    )
    return (
        f"<Slave><Info><Name><![CDATA[{name}]]></Name>{info}</Info>{data}{mailbox}"
        f"<InitCmds>{registers}</InitCmds>{more}</Slave>\n"
    )


def task(cycle_us: int | None, address: int, length: int, comment: str = "") -> str:
    """A cyclic task with one datagram."""
    cycle = "" if cycle_us is None else f"<CycleTime>{cycle_us}</CycleTime>"
    return (
        f"<Cyclic>{cycle}<Comment>{comment}</Comment><Frame><Cmd><Cmd>12</Cmd>"
        f"<Addr>{address}</Addr><DataLength>{length}</DataLength></Cmd></Frame></Cyclic>\n"
    )


def eni(*parts: str) -> str:
    """A whole file of slaves and tasks."""
    return (
        '<?xml version="1.0" encoding="utf-8"?>\n<EtherCATConfig Version="1.3"><Config>\n'
        "<Master><Info><Name>Press</Name></Info><InitCmds><InitCmd/><InitCmd/></InitCmds>"
        f"</Master>\n{''.join(parts)}</Config></EtherCATConfig>\n"
    )


def ids(vendor: int, product: int, revision: int = 0, automatic: int | None = None) -> str:
    """What identifies a slave."""
    text = "" if automatic is None else f"<AutoIncAddr>{automatic}</AutoIncAddr>"
    return (
        f"{text}<VendorId>{vendor}</VendorId><ProductCode>#x{product:08x}</ProductCode>"
        f"<RevisionNo>{revision}</RevisionNo><SerialNo>0</SerialNo>"
    )


_CHANNELS = "".join(
    f'<RxPdo Fixed="1" Sm="0"><Index>{0x1600 + n}</Index><Name>Channel {n + 1}</Name><Entry>'
    f"<Index>{0x7000 + 16 * n}</Index><SubIndex>1</SubIndex><BitLen>1</BitLen><Name>Output</Name>"
    "<DataType>BOOL</DataType></Entry></RxPdo>"
    for n in range(8)
)
_TERMINAL = (
    "<ProcessData><Send><BitStart>0</BitStart><BitLength>8</BitLength></Send>"
    "<Sm0><Type>Outputs</Type><ControlByte>68</ControlByte><Pdo>5632</Pdo></Sm0>"
    f"{_CHANNELS}</ProcessData>"
)
_AXIS = (
    "<ProcessData><Send><BitLength>104</BitLength></Send><Recv><BitLength>64</BitLength></Recv>"
    "<Sm2><Type>Outputs</Type><ControlByte>#x64</ControlByte><Pdo>#x1600</Pdo></Sm2>"
    "<Sm3><Type>Inputs</Type><ControlByte>#x20</ControlByte><Pdo>#x1a00</Pdo></Sm3>"
    "<RxPdo><Index>#x1600</Index><Name>All targets</Name><Entry><Index>#x6040</Index>"
    "<BitLen>16</BitLen><Name>Controlword</Name><DataType>UINT</DataType></Entry></RxPdo>"
    "</ProcessData>"
)
MACHINE = eni(
    # The order of the file is not that of the wire: auto-increment addresses tell that.
    slave(
        "Press (CiA402)",
        ids(0xFFFF, 0x402, 1, -2),
        data=_AXIS,
        objects=coe(0x6060, 0, "08", "IP", more="<Comment>mode\tCSP</Comment>")
        + coe(0x1C12, 0, "01000016", ca=1)
        + coe(0x1A00, 0, "00")
        + coe(0x1A00, 1, "10004160")
        + coe(0x1A00, 2, "20006460")
        + coe(0x1A00, 3, "10000000")
        + coe(0x1A00, 0, "03")
        + coe(0x1A01, 0, "00")
        + coe(0x6065, 0, "d2040000", "PS", "SO", ccs=2),
        registers=command(0x0120, "0200", "IP")
        + command(0x0980, "0000", "IP")
        + command(0x09A0, (2_000_000).to_bytes(4, "little").hex() + "00000000")
        + command(0x0990, (250_000).to_bytes(8, "little").hex())
        + command(0x0980, "0003")
        + fmmu(0, 0x01000000, 13, outputs=True)
        + fmmu(1, 0x01000000, 8, outputs=False),
        more="<DC><ReferenceClock>0</ReferenceClock><CycleTime0>2000000</CycleTime0>"
        "<ShiftTime>250000</ShiftTime></DC>",
    ),
    slave(
        "Term 1 (EK1100)",
        ids(2, 0x044C2C52, 0x00120000, 0),
        registers=command(0x0120, "1100", "PI", "SI", cmd=2) + command(0, "", cmd=0),
        more="<DC><ReferenceClock>1</ReferenceClock></DC><PreviousPort><Port>B</Port></PreviousPort>",
    ),
    slave(
        "Term 2 (EL2008)",
        ids(2, 0x07D83052, 0x00100000, 65535),
        data=_TERMINAL,
        registers=command(0x0400, "c209", "IP")
        + command(0x0420, "f401", "IP")
        + fmmu(0, 0x01000100, 1, outputs=True),
    ),
    slave(
        "Term 3 (ElmoGold)",
        ids(0x9A, 0x00030924, 0x00010420, 65533),
        objects=coe(0x1C12, 1, "0516")
        + coe(0x1C12, 0, "01")
        + coe(0x1C13, 0, "00")
        + coe(0x1C13, 1, "021a")
        + coe(0x1C13, 2, "0a1a")
        + coe(0x1C13, 0, "02")
        + coe(0x6081, 0, "10270000", "SO")
        + coe(0x6081, 0, "00000000", "OS")
        + coe(0x1018, 1, "", ccs=2)
        + coe(0x6082, 0, "00", more="<Disabled>1</Disabled>"),
        registers=command(0x0F10, "01", "SO") + fmmu(0, 0x01000020, 4, outputs=True),
        more="<Modules/>",
    ),
    task(8000, 0x01000100, 4, "slow"),
    task(2000, 0x01000000, 64, "fast"),
)
"""A machine as the simulator has it: EK1100, EL2008, CiA402, ElmoGold."""
