"""Files about drives with SoE, of our own: shapes that vendors and tools write.

`SHAPES` has ESI files by the name of what is special about them.
"""

_HEAD = """<?xml version="1.0" encoding="utf-8"?>
<EtherCATInfo Version="1.6">
  <Vendor><Id>#x0000FFFF</Id><Name>Example</Name></Vendor>
  <Descriptions><Groups/><Devices>
    <Device Physics="YY">
      <Type ProductCode="#x00005001" RevisionNo="#x00010000">Servo2</Type>
      <Name>Two axes with SoE</Name>
      <Fmmu>Outputs</Fmmu><Fmmu>Inputs</Fmmu>
      <Sm StartAddress="#x1000" DefaultSize="256" ControlByte="#x26" Enable="1">MBoxOut</Sm>
      <Sm StartAddress="#x1100" DefaultSize="256" ControlByte="#x22" Enable="1">MBoxIn</Sm>
      <Sm StartAddress="#x1200" DefaultSize="12" ControlByte="#x64" Enable="1">Outputs</Sm>
      <Sm StartAddress="#x1300" DefaultSize="12" ControlByte="#x20" Enable="1">Inputs</Sm>
"""
_TAIL = """
      <Eeprom><ByteSize>2048</ByteSize><ConfigData>050C000000000000</ConfigData></Eeprom>
    </Device>
  </Devices></Descriptions>
</EtherCATInfo>
"""


def _entry(index: int, subindex: int, bits: int, name: str, kind: str) -> str:
    return (
        f"<Entry><Index>#x{index:04X}</Index><SubIndex>{subindex}</SubIndex><BitLen>{bits}</BitLen>"
        f"<Name>{name}</Name><DataType>{kind}</DataType></Entry>"
    )


def _telegrams(*, subindex: int = 0, words: bool = True) -> str:
    """MDT and AT of two drives; `words`: with control word and status word."""
    parts = []
    for drive in (0, 1):
        sub = subindex + drive
        control = _entry(134, sub, 16, "Master control word", "UINT") if words else ""
        status = _entry(135, sub, 16, "Drive status word", "UINT") if words else ""
        velocity = _entry(36, sub, 32, "Velocity command value", "DINT")
        position = _entry(51, sub, 32, "Position feedback value 1", "DINT")
        parts.append(
            f'<RxPdo Fixed="1" Sm="2"><Index>#x{0x0018 + 0x1000 * drive:04X}</Index>'
            f"<Name>MDT {drive + 1}</Name>{control}{velocity}</RxPdo>"
            f'<TxPdo Fixed="1" Sm="3"><Index>#x{0x0010 + 0x1000 * drive:04X}</Index>'
            f"<Name>AT {drive + 1}</Name>{status}{position}</TxPdo>"
        )
    return "".join(parts)


_COMMAND = (
    "<InitCmd>{chosen}<Transition>PS</Transition><Comment>AT list</Comment><IDN>16</IDN>"
    "<Data>020002003300</Data></InitCmd>"
    "<InitCmd><Transition>PS</Transition><IDN>32777</IDN><Data>0700</Data></InitCmd>"
)


def _file(telegrams: str, mailbox: str) -> str:
    return f"{_HEAD}{telegrams}<Mailbox>{mailbox}</Mailbox>{_TAIL}"


SHAPES = {
    "indices are IDNs": _file(_telegrams(), "<SoE/>"),
    "subindices begin at 1": _file(_telegrams(subindex=1), "<SoE/>"),
    "telegrams without control word": _file(_telegrams(words=False), "<SoE/>"),
    "InitCmd in SoE": _file(_telegrams(), f"<SoE>{_COMMAND.format(chosen='')}</SoE>"),
    "InitCmd in InitCmds": _file(
        _telegrams(),
        f"<SoE><InitCmds>{_COMMAND.format(chosen='<DriveNo>1</DriveNo>')}</InitCmds></SoE>",
    ),
}

NETWORK = """<?xml version="1.0"?>
<EtherCATConfig Version="1.3"><Config>
  <Master><Info><Name>Servo line</Name></Info></Master>
  <Slave>
    <Info>
      <Name>Servo 1 (Servo2)</Name><PhysAddr>1001</PhysAddr><AutoIncAddr>0</AutoIncAddr>
      <VendorId>65535</VendorId><ProductCode>20481</ProductCode><RevisionNo>65536</RevisionNo>
    </Info>
    <Mailbox>
      <Send><Start>4096</Start><Length>256</Length></Send>
      <Recv><Start>4352</Start><Length>256</Length></Recv>
      <Protocol>SoE</Protocol>
      <SoE><InitCmds>
        <InitCmd><Transition>PS</Transition><Comment>AT list</Comment><Timeout>0</Timeout>
          <OpCode>3</OpCode><DriveNo>0</DriveNo><IDN>16</IDN><Elements>64</Elements>
          <Attribute>0</Attribute><Data>0400040033002800</Data></InitCmd>
        <InitCmd><Transition>PS</Transition><Transition>SO</Transition><Comment>brake</Comment>
          <OpCode>3</OpCode><DriveNo>1</DriveNo><IDN>32828</IDN><Elements>64</Elements>
          <Attribute>0</Attribute><Data>1100</Data></InitCmd>
        <InitCmd><Transition>PS</Transition><OpCode>1</OpCode><DriveNo>0</DriveNo><IDN>17</IDN>
          <Elements>64</Elements><Attribute>0</Attribute></InitCmd>
      </InitCmds></SoE>
    </Mailbox>
  </Slave>
  <Cyclic><CycleTime>2000</CycleTime></Cyclic>
</Config></EtherCATConfig>
"""
