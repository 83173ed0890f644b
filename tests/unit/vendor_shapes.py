"""ESI files of our own in the shapes in which vendors ship theirs, against ETG.2000 and ETG.2010.

Each shape is named after a device that has it. No file of a vendor is here.
"""

from __future__ import annotations

from dataclasses import dataclass

MAILBOX = (
    '<Sm StartAddress="#x1000" DefaultSize="128" ControlByte="#x26" Enable="1">MBoxOut</Sm>'
    '<Sm StartAddress="#x1080" DefaultSize="128" ControlByte="#x22" Enable="1">MBoxIn</Sm>'
)
DATA = (
    '<Sm StartAddress="#x1100" DefaultSize="2" ControlByte="#x64" Enable="1">Outputs</Sm>'
    '<Sm StartAddress="#x1200" DefaultSize="2" ControlByte="#x20" Enable="1">Inputs</Sm>'
)
COE = '<Mailbox><CoE SdoInfo="1"/></Mailbox>'
EEPROM = "<Eeprom><ByteSize>2048</ByteSize><ConfigData>0500000000000000</ConfigData></Eeprom>"


def entry(index: int, subindex: int, bits: int = 16, kind: str = "UINT", name: str = "val") -> str:
    return (
        f"<Entry><Index>#x{index:x}</Index><SubIndex>{subindex}</SubIndex><BitLen>{bits}</BitLen>"
        f"<Name>{name}</Name><DataType>{kind}</DataType></Entry>"
    )


def pdo(tag: str, sm: int | None, index: int, *entries: str, name: str = "P") -> str:
    place = "" if sm is None else f' Sm="{sm}"'
    return f"<{tag}{place}><Index>#x{index:x}</Index><Name>{name}</Name>{''.join(entries)}</{tag}>"


OUT = pdo("RxPdo", 2, 0x1600, entry(0x7000, 1))
IN = pdo("TxPdo", 3, 0x1A00, entry(0x6000, 1))


def esi(
    *parts: str, encoding: str = "UTF-8", name: str = "Sample", profile: str = "", more: str = ""
) -> str:
    """An ESI file with one device.

    Args:
        parts: What follows `<Fmmu>` in `<Device>`; default: sync managers, two PDOs, CoE, EEPROM.
        encoding: Encoding that the file declares.
        name: Name of the device.
        profile: What is in `<Profile>`.
        more: Further devices.
    """
    body = "".join(parts or (MAILBOX, DATA, OUT, IN, COE, EEPROM))
    return (
        f'<?xml version="1.0" encoding="{encoding}"?>\n<EtherCATInfo><Vendor><Id>#xFF02</Id>'
        f"<Name>Sample</Name></Vendor><Descriptions><Groups/><Devices>{more}\n"
        '<Device Physics="YY"><Type ProductCode="#x1" RevisionNo="1">Shape</Type>'
        f"<Name>{name}</Name>{profile and f'<Profile>{profile}</Profile>'}"
        f"<Fmmu>Outputs</Fmmu><Fmmu>Inputs</Fmmu>{body}</Device>\n"
        "</Devices></Descriptions></EtherCATInfo>\n"
    )


def category(number: int, data: str) -> str:
    return EEPROM.replace(
        "</Eeprom>",
        f"<Category><CatNo>{number}</CatNo><Data>{data}</Data></Category></Eeprom>",
    )


def limited(kind: str, bits: int, info: str) -> str:
    """A dictionary with one object."""
    return (
        f"<Dictionary><DataTypes><DataType><Name>{kind}</Name><BitSize>{bits}</BitSize></DataType>"
        "</DataTypes><Objects><Object><Index>#x6064</Index><Name>p</Name>"
        f"<Type>{kind}</Type><BitSize>{bits}</BitSize><Info>{info}</Info></Object></Objects>"
        "</Dictionary>"
    )


@dataclass(frozen=True)
class Shape:
    """A shape of a file.

    Attributes:
        text: The file.
        said: What the reader must say, with ` | ` between; empty: nothing is wrong.
        outputs: Bytes of outputs that the device has by default.
        inputs: Bytes of inputs.
        refused: Whether a simulation must refuse it, since values would be in wrong places.
    """

    text: str
    said: str = ""
    outputs: int = 2
    inputs: int = 2
    refused: bool = False


_DC = "<Dc><OpMode><Name>{}</Name><AssignActivate>#x300</AssignActivate></OpMode></Dc>"
_NO_INDEX = '<RxPdo Sm="2" Ref="Outputs16"/>'
_TWICE = '<Device Physics="YY"><Type ProductCode="#x1" RevisionNo="1">Shape</Type></Device>'
_WIDE = pdo("TxPdo", 3, 0x1A00, entry(0x6000, 1, 600, "ARRAY [0..74] OF BYTE"), entry(0x6001, 1))
_UNKNOWN = pdo("RxPdo", 2, 0x1600, "<Entry><Index>#x7000</Index><Name>lost</Name></Entry>")

SHAPES = {
    "Elmo Gold: category 30 a second time": Shape(
        esi(MAILBOX, DATA, OUT, IN, COE, category(30, "00" * 8)), "category 30 | left out"
    ),
    "Inovance IS620N: an impossible limit": Shape(
        esi(profile=limited("DINT", 32, "<MinValue>-4294967295</MinValue>")),
        "<MinValue> | -4294967295 | this limit is left out",
    ),
    "an impossible default": Shape(
        esi(profile=limited("USINT", 8, "<DefaultData>112233</DefaultData>")),
        "<DefaultData> | 3 bytes | this default is left out",
    ),
    "a data type that is shorter than its entry": Shape(
        esi(MAILBOX, DATA, OUT, pdo("TxPdo", 3, 0x1A00, entry(0x6000, 1, 32, "INT")), COE, EEPROM),
        "'INT' | 16 bits | <BitLen> is 32 | DINT is used",
        inputs=4,
    ),
    "a length that is there twice": Shape(
        esi(
            *(MAILBOX, DATA, OUT),
            IN.replace("<BitLen>", "<BitLen>8</BitLen><BitLen>"),
            *(COE, EEPROM),
        ),
        "two <BitLen> | '8' | '16' | this PDO is left out",
        inputs=0,
    ),
    "Enable in words": Shape(
        esi(MAILBOX, DATA.replace('Enable="1"', 'Enable="true"'), OUT, IN, COE, EEPROM)
    ),
    "EK1960: a disabled sync manager at 0": Shape(
        esi(
            MAILBOX,
            DATA,
            '<Sm DefaultSize="0" StartAddress="#x0" ControlByte="#x4" Enable="0">Outputs</Sm>',
            *(OUT, IN, COE, EEPROM),
        )
    ),
    "EL1252: a sync manager without PDO": Shape(
        esi(
            '<Sm StartAddress="#x1000" ControlByte="#x0" Enable="1">Inputs</Sm>',
            '<Sm StartAddress="#x1100" ControlByte="#x0" Enable="1">Inputs</Sm>',
            pdo("TxPdo", 0, 0x1A00, entry(0x6000, 1)),
            EEPROM,
        ),
        "sync manager 1 | no PDO | it is not used",
        outputs=0,
    ),
    "SMC EX250: a mailbox without sync managers": Shape(
        esi(
            '<Sm StartAddress="#x1100" ControlByte="#x44" Enable="1">Outputs</Sm>',
            *(pdo("RxPdo", 0, 0x1600, entry(0x7000, 1)), COE, EEPROM),
        ),
        "<Mailbox> | MBoxOut | it has no mailbox",
        inputs=0,
    ),
    "older Beckhoff: a PDO that refers to another file": Shape(
        esi(MAILBOX, DATA, _NO_INDEX, IN, COE, EEPROM),
        "<RxPdo> | 'Outputs16' | this PDO is left out",
        outputs=0,
    ),
    "a PDO behind one that cannot be read": Shape(
        esi(MAILBOX, DATA, _NO_INDEX, OUT, IN, COE, EEPROM), "'Outputs16'", refused=True
    ),
    "an entry without a size": Shape(
        esi(MAILBOX, DATA, _UNKNOWN, pdo("RxPdo", 2, 0x1601, entry(0x7001, 1)), IN, COE, EEPROM),
        "<Entry> | <BitLen>",
        refused=True,
    ),
    "older Beckhoff: a device twice": Shape(esi(more=_TWICE), "described a second time", 0, 0),
    "Pollen: sync managers with names of their own": Shape(
        esi(MAILBOX, DATA.replace(">Outputs<", ">AxisIn<"), OUT, IN, COE, EEPROM),
        "'AxisIn' | Outputs is used",
    ),
    "saved by a master: sync managers without text": Shape(
        esi(
            MAILBOX.replace("MBoxOut", "").replace("MBoxIn", ""),
            DATA.replace("Outputs", "").replace("Inputs", ""),
            *(OUT, IN, COE, EEPROM),
        )
    ),
    "saved by a master: a list of files": Shape(
        esi()
        .replace("<EtherCATInfo>", "<EtherCATInfoList><EtherCATInfo>")
        .replace("</EtherCATInfo>", "</EtherCATInfo></EtherCATInfoList>")
    ),
    "Synapticon: entries with the index of a PDO": Shape(
        esi(
            *(MAILBOX, DATA, pdo("RxPdo", 2, 0x1600, entry(0x1600, 1))),
            *(pdo("TxPdo", 3, 0x1A00, entry(0x1A00, 1, kind="INT")), COE, EEPROM),
        ),
        "0x1600:01 | index of a PDO | it is used",
    ),
    "a sync manager that does not exist": Shape(
        esi(MAILBOX, DATA, OUT, pdo("TxPdo", 7, 0x1A00, entry(0x6000, 1)), COE, EEPROM),
        "Sm | <TxPdo> | 7 | 4 sync managers | not assigned by default",
        inputs=0,
    ),
    "PDOs twice, one of them assigned": Shape(
        esi(MAILBOX, DATA, pdo("RxPdo", None, 0x1600, entry(0x7009, 1)), OUT, IN, COE, EEPROM),
        "<RxPdo> | 0x1600 | second",
    ),
    "PDOs twice, both assigned": Shape(
        esi(MAILBOX, DATA, pdo("RxPdo", 2, 0x1600, entry(0x7009, 1)), OUT, IN, COE, EEPROM),
        "<RxPdo> | 0x1600 | second | other entries",
        refused=True,
    ),
    "an entry without bits": Shape(
        esi(MAILBOX, DATA, pdo("RxPdo", 2, 0x1600, entry(0x7000, 1, 0), entry(0x7000, 2)), IN, COE),
        "<BitLen> | 0 | this entry is left out",
    ),
    "an entry of more bits than a mapping can say": Shape(
        esi(MAILBOX, DATA, OUT, _WIDE, COE, EEPROM),
        "<BitLen> | 600 | 255 | keep their place",
        inputs=77,
    ),
    "types from CiA 301 and C": Shape(
        esi(
            *(MAILBOX, DATA, pdo("RxPdo", 2, 0x1600, entry(0x7000, 1, kind="UNSIGNED16"))),
            *(pdo("TxPdo", 3, 0x1A00, entry(0x6000, 1, 32, "DINT32")), COE, EEPROM),
        ),
        inputs=4,
    ),
    "PDOs in small letters": Shape(
        esi(MAILBOX, DATA, OUT, IN.replace("TxPdo", "txpdo"), COE, EEPROM),
        "<txpdo> | <TxPdo> | left out",
        inputs=0,
    ),
    "an attribute in capitals": Shape(
        esi(MAILBOX, DATA, OUT, IN.replace("Sm=", "SM="), COE, EEPROM),
        "SM of <TxPdo> should be Sm",
        inputs=0,
    ),
    "a second mailbox": Shape(
        esi(MAILBOX, DATA, OUT, IN, COE, '<Mailbox><CoE PdoAssign="1"/></Mailbox>', EEPROM),
        "<Device> | another <Mailbox> | left out",
    ),
    "a second EEPROM": Shape(
        esi(MAILBOX, DATA, OUT, IN, COE, EEPROM, category(2000, "11")), "another <Eeprom> | left"
    ),
    "a second description of the clocks": Shape(
        esi(MAILBOX, DATA, OUT, IN, COE, _DC.format("A"), _DC.format("B"), EEPROM), "another <Dc>"
    ),
    "the same mailbox twice": Shape(esi(MAILBOX, DATA, OUT, IN, COE, COE, EEPROM)),
    "an empty sync manager": Shape(
        esi(MAILBOX, DATA, OUT, IN.replace('Sm="3"', 'Sm=""'), COE, EEPROM),
        "Sm of <TxPdo> is empty | not assigned by default",
        inputs=0,
    ),
    "PDOs that exclude each other by default": Shape(
        esi(
            *(MAILBOX, DATA, OUT, IN.replace("<Name>", "<Exclude>#x1A01</Exclude><Name>", 1)),
            *(pdo("TxPdo", 3, 0x1A01, entry(0x6001, 1)), COE, EEPROM),
        ),
        "0x1A00 excludes 0x1A01 | both",
        inputs=4,
    ),
    "a device without a revision": Shape(
        esi().replace(' RevisionNo="1"', ""), "<Type> has no RevisionNo | 0 is used"
    ),
    "a device without a product code": Shape(
        esi().replace(' ProductCode="#x1"', ""), "<Type> has no ProductCode | 0 is used"
    ),
    "a vendor without an ID": Shape(
        esi().replace("<Id>#xFF02</Id>", "<Id></Id>"), "<Id> | its vendor ID is 0"
    ),
    "a document type": Shape(
        esi().replace("?>\n", '?>\n<!DOCTYPE EtherCATInfo SYSTEM "EtherCATInfo.dtd">', 1)
    ),
    "names of HTML": Shape(
        esi(name="St&ouml;rung&nbsp;&copy; &amp; &#246;", profile="<!-- &uuml; -->"),
        "'&copy;', '&nbsp;', '&ouml;' | HTML | the characters that they mean are used",
    ),
    "empty lines in front": Shape("\n \r\n" + esi()),
    "zeros behind the end": Shape(esi() + "\0" * 64, "control characters | left out"),
    "a text behind the end": Shape(esi() + "end", "follows the end of <EtherCATInfo>"),
}

ENCODINGS = {
    "GB2312": "伺服驱动器",
    "GBK": "伺服驅動器",  # GBK has traditional letters, too
    "GB18030": "伺服驱动器㐀",
    "Big5": "伺服驅動器",
    "Shift_JIS": "サーボ①",  # a letter that only Microsoft's variant has
    "EUC-JP": "サーボ",
    "EUC-KR": "서보 드라이브",
    "windows-1250": "Měnič",
    "windows-1251": "Привод",
    "windows-1252": "Antrieb – µm",
    "iso-8859-1": "Antrieb µm",
    "utf-8": "伺服",
    "utf-16": "伺服",
}
"""A name of a device in each encoding that vendors use."""
