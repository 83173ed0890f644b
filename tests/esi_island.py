"""An ESI file of a device with slots for modules (ETG.5001)."""

ISLAND = """<?xml version="1.0"?>
<EtherCATInfo><Vendor><Id>#xFFFF</Id><Name>Nobody</Name></Vendor><Descriptions>
<Devices>
<Device Physics="YY"><Type ProductCode="#x77" RevisionNo="#x1">Island</Type><Name>Island</Name>
  <Fmmu>Outputs</Fmmu><Fmmu>Inputs</Fmmu>
  <Sm StartAddress="#x1000" DefaultSize="128" ControlByte="#x26" Enable="1">MBoxOut</Sm>
  <Sm StartAddress="#x1080" DefaultSize="128" ControlByte="#x22" Enable="1">MBoxIn</Sm>
  <Sm StartAddress="#x1100" ControlByte="#x64" Enable="1">Outputs</Sm>
  <Sm StartAddress="#x1400" ControlByte="#x20" Enable="1">Inputs</Sm>
  <TxPdo Sm="3" Mandatory="1" Fixed="1"><Index>#x1AFF</Index><Name>State</Name>
    <Entry><Index>#xF100</Index><SubIndex>1</SubIndex><BitLen>16</BitLen><Name>Diagnosis</Name>
      <DataType>UINT</DataType></Entry></TxPdo>
  <Mailbox><CoE SdoInfo="1" PdoUpload="1"/></Mailbox>
  <Slots SlotIndexIncrement="#x10" SlotPdoIncrement="1" MaxSlotCount="3">
    <Slot MinInstances="0" MaxInstances="2"><Name>I/O</Name>
      <ModuleClass><Class>io</Class><Name>I/O modules</Name></ModuleClass></Slot>
    <Slot MinInstances="0" MaxInstances="1" SlotIndexIncrement="#x800"><Name>Axis</Name>
      <ModuleIdent Default="1">#x0303</ModuleIdent></Slot>
  </Slots></Device>
<Device Physics="YY"><Type ProductCode="#x78" RevisionNo="#x1">Plain</Type>
  <Name>Plain</Name></Device>
</Devices>
<Modules>
<Module><Type ModuleIdent="#x0101" ModuleClass="io">DI2</Type><Name>Two inputs</Name>
  <TxPdo Sm="3" Fixed="1"><Index DependOnSlot="1">#x1A00</Index><Name>Inputs</Name>
    <Entry><Index DependOnSlot="1">#x6000</Index><SubIndex>1</SubIndex><BitLen>1</BitLen>
      <Name>Input 1</Name><DataType>BOOL</DataType></Entry>
    <Entry><Index DependOnSlot="true">#x6000</Index><SubIndex>2</SubIndex><BitLen>1</BitLen>
      <Name>Input 2</Name><DataType>BOOL</DataType></Entry>
    <Entry><Index>0</Index><BitLen>6</BitLen></Entry></TxPdo></Module>
<Module><Type ModuleIdent="#x0202" ModuleClass="io">AO1</Type><Name>One output</Name>
  <RxPdo Sm="2"><Index DependOnSlot="1">#x1600</Index><Exclude DependOnSlot="1">#x1608</Exclude>
    <Name>Output</Name>
    <Entry><Index DependOnSlot="1">#x7000</Index><SubIndex>1</SubIndex><BitLen>16</BitLen>
      <Name>Output</Name><DataType>INT</DataType></Entry></RxPdo>
  <Mailbox><CoE><InitCmds><InitCmd><Transition>PS</Transition><Index DependOnSlot="1">#x8000</Index>
    <SubIndex>0</SubIndex><Data>0500</Data><Comment>range</Comment></InitCmd></InitCmds></CoE></Mailbox>
  <Profile><Dictionary><DataTypes><DataType><Name>UINT</Name><BitSize>16</BitSize></DataType>
    <DataType><Name>INT</Name><BitSize>16</BitSize></DataType></DataTypes><Objects>
    <Object><Index DependOnSlot="1">#x8000</Index><Name>Range</Name><Type>UINT</Type>
      <BitSize>16</BitSize><Flags><Access>rw</Access></Flags></Object></Objects></Dictionary></Profile>
</Module>
<Module><Type ModuleIdent="#x0303" ModuleClass="axis">Axis</Type><Name>Axis</Name>
  <RxPdo Sm="2"><Index>#x1700</Index><Name>Control</Name>
    <Entry><Index DependOnSlot="1">#x6040</Index><SubIndex>0</SubIndex><BitLen>16</BitLen>
      <Name>Controlword</Name><DataType>UINT</DataType></Entry></RxPdo></Module>
<Module><Type ModuleIdent="#x0999" ModuleClass="other">Foreign</Type><Name>Foreign</Name></Module>
</Modules></Descriptions></EtherCATInfo>"""
