"""An ESI file of our own with everything that the reader knows."""

SAMPLE = """<?xml version="1.0" encoding="utf-8"?>
<EtherCATInfo xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" Version="1.6">
  <Vendor>
    <Id>#x0000FFFF</Id>
    <Name LcId="1031">Beispiel</Name>
    <Name LcId="1033">Example</Name>
  </Vendor>
  <Descriptions>
    <Groups>
      <Group><Type>Drives</Type><Name LcId="1033">All drives</Name></Group>
    </Groups>
    <Devices>
      <Device Physics="YKY">
        <Type ProductCode="#x00001234" RevisionNo="#x00020001">AX2</Type>
        <Name LcId="1031">Antrieb</Name>
        <Name LcId="1033"><![CDATA[Axis µ]]></Name>
        <Info><Electrical><EBusCurrent>-150</EBusCurrent></Electrical></Info>
        <GroupType>Drives</GroupType>
        <Profile>
          <ProfileNo>402</ProfileNo>
          <Dictionary>
            <DataTypes>
              <DataType><Name>UDINT</Name><BitSize>32</BitSize></DataType>
              <DataType>
                <Name>DT0801EN8</Name><BaseType>USINT</BaseType><BitSize>8</BitSize>
                <EnumInfo><Text>off</Text><Enum>0</Enum></EnumInfo>
              </DataType>
              <DataType>
                <Name>DT2000</Name><BitSize>72</BitSize>
                <SubItem>
                  <SubIdx>0</SubIdx><Name>SubIndex 000</Name><Type>USINT</Type>
                  <BitSize>8</BitSize><BitOffs>0</BitOffs>
                </SubItem>
                <SubItem>
                  <SubIdx>1</SubIdx><Name>Mode</Name><Type>DT0801EN8</Type>
                  <BitSize>8</BitSize><BitOffs>16</BitOffs>
                  <Flags><Access WriteRestrictions="PreOP_SafeOP">rw</Access><Backup>1</Backup>
                    <Setting>1</Setting></Flags>
                </SubItem>
                <SubItem>
                  <SubIdx>3</SubIdx><Name>Limit</Name><Type>INT</Type>
                  <BitSize>16</BitSize><BitOffs>24</BitOffs>
                  <Flags><Access>rw</Access></Flags>
                </SubItem>
                <SubItem>
                  <SubIdx>4</SubIdx><Name>Gain</Name><Type>REAL</Type>
                  <BitSize>32</BitSize><BitOffs>40</BitOffs>
                  <Flags><Access>wo</Access></Flags>
                </SubItem>
              </DataType>
              <DataType>
                <Name>ARRAY [0..511] OF BYTE</Name><BaseType>BYTE</BaseType>
                <BitSize>4096</BitSize>
                <ArrayInfo><LBound>0</LBound><Elements>512</Elements></ArrayInfo>
              </DataType>
              <DataType>
                <Name>DT2003</Name><BitSize>4112</BitSize>
                <SubItem>
                  <SubIdx>0</SubIdx><Name>SubIndex 000</Name><Type>USINT</Type>
                  <BitSize>8</BitSize><BitOffs>0</BitOffs>
                </SubItem>
                <SubItem>
                  <SubIdx>1</SubIdx><Name>Buffer</Name><Type>ARRAY [0..511] OF BYTE</Type>
                  <BitSize>4096</BitSize><BitOffs>16</BitOffs>
                </SubItem>
              </DataType>
              <DataType>
                <Name>DT2001ARR</Name><BaseType>UINT</BaseType><BitSize>48</BitSize>
                <ArrayInfo><LBound>1</LBound><Elements>3</Elements></ArrayInfo>
              </DataType>
              <DataType>
                <Name>DT2001</Name><BitSize>64</BitSize>
                <SubItem>
                  <SubIdx>0</SubIdx><Name>SubIndex 000</Name><Type>USINT</Type>
                  <BitSize>8</BitSize><BitOffs>0</BitOffs>
                </SubItem>
                <SubItem>
                  <Name>Elements</Name><Type>DT2001ARR</Type>
                  <BitSize>48</BitSize><BitOffs>16</BitOffs>
                  <Flags><Access>rw</Access></Flags>
                </SubItem>
              </DataType>
            </DataTypes>
            <Objects>
              <Object>
                <Index>#x1000</Index><Name>Device type</Name><Type>UDINT</Type>
                <BitSize>32</BitSize><Info><DefaultData>92010200</DefaultData></Info>
              </Object>
              <Object>
                <Index>#x1008</Index><Name>Device name</Name><Type>STRING(6)</Type>
                <BitSize>48</BitSize><Info><DefaultString>Axis 2</DefaultString></Info>
              </Object>
              <Object>
                <Index>#x1009</Index><Name>Hardware</Name><Type>STRING(0)</Type>
                <BitSize>0</BitSize><Info><DefaultString>1.0</DefaultString></Info>
              </Object>
              <Object>
                <Index>#x2000</Index><Name>Settings</Name><Type>DT2000</Type>
                <BitSize>72</BitSize>
                <Info>
                  <SubItem><Name>SubIndex 000</Name>
                    <Info><DefaultValue>4</DefaultValue></Info></SubItem>
                  <SubItem><Name>Limit</Name>
                    <Info><MinValue>-10</MinValue><MaxValue>#x64</MaxValue>
                      <DefaultValue>-2</DefaultValue><Unit>#xFD440000</Unit></Info></SubItem>
                  <SubItem><Name>Gain</Name>
                    <Info><DefaultValue>1.5</DefaultValue></Info></SubItem>
                </Info>
              </Object>
              <Object>
                <Index>#x2001</Index><Name>Table</Name><Type>DT2001</Type><BitSize>64</BitSize>
                <Info>
                  <SubItem><Name>SubIndex 000</Name>
                    <Info><DefaultData>03</DefaultData></Info></SubItem>
                  <SubItem><Name>SubIndex 001</Name>
                    <Info><DefaultData>0100</DefaultData></Info></SubItem>
                  <SubItem><Name>SubIndex 003</Name>
                    <Info><DefaultData>0003</DefaultData></Info></SubItem>
                </Info>
              </Object>
              <Object>
                <Index>#x2002</Index><Name>Key</Name><Type>ARRAY [0..3] OF BYTE</Type>
                <BitSize>32</BitSize><Info><DefaultData>01020304</DefaultData></Info>
              </Object>
              <Object>
                <Index>#x2003</Index><Name>Buffers</Name><Type>DT2003</Type>
                <BitSize>4112</BitSize>
              </Object>
              <Object>
                <Index>#x6040</Index><Name>Controlword</Name><Type>UINT</Type>
                <BitSize>16</BitSize><Info><DefaultData>0600</DefaultData></Info>
                <Flags><Access>rw</Access><PdoMapping>R</PdoMapping></Flags>
              </Object>
              <Object>
                <Index>#x6041</Index><Name>Statusword</Name><Type>UINT</Type>
                <BitSize>16</BitSize>
                <Flags><Access>ro</Access><PdoMapping>T</PdoMapping></Flags>
              </Object>
            </Objects>
          </Dictionary>
        </Profile>
        <Fmmu>Outputs</Fmmu><Fmmu>Inputs</Fmmu><Fmmu>MBoxState</Fmmu>
        <Sm DefaultSize="128" StartAddress="#x1000" ControlByte="#x26" Enable="1">MBoxOut</Sm>
        <Sm DefaultSize="128" StartAddress="#x1080" ControlByte="#x22" Enable="1">MBoxIn</Sm>
        <Sm DefaultSize="6" StartAddress="#x1100" ControlByte="#x64" Enable="1">Outputs</Sm>
        <Sm DefaultSize="4" StartAddress="#x1180" ControlByte="#x20" Enable="1">Inputs</Sm>
        <RxPdo Sm="2" Fixed="1" Mandatory="true">
          <Index>#x1600</Index><Name>Control</Name><Exclude>#x1602</Exclude>
          <Entry><Index>#x6040</Index><SubIndex>0</SubIndex><BitLen>16</BitLen>
            <Name>Controlword</Name><DataType>UINT</DataType></Entry>
        </RxPdo>
        <RxPdo Sm="2">
          <Index>#x1601</Index><Name>Target</Name>
          <Entry><Index>#x607A</Index><BitLen>32</BitLen>
            <Name>Target position</Name><DataType>DINT</DataType></Entry>
        </RxPdo>
        <RxPdo>
          <Index>#x1602</Index><Name>Other control</Name><Exclude>#x1600</Exclude>
          <Entry><Index>#x6040</Index><SubIndex>0</SubIndex><BitLen>16</BitLen></Entry>
        </RxPdo>
        <TxPdo Sm="3" Fixed="0">
          <Index>#x1A00</Index><Name>Status</Name>
          <Entry><Index>#x6041</Index><SubIndex>0</SubIndex><BitLen>16</BitLen>
            <Name>Statusword</Name><DataType>UINT</DataType></Entry>
          <Entry><Index>0</Index><BitLen>5</BitLen></Entry>
          <Entry><Index>#x2100</Index><SubIndex>#x01</SubIndex><BitLen>3</BitLen>
            <Name>Bits</Name><DataType>DT2100</DataType></Entry>
          <Entry><Index>#x2100</Index><SubIndex>2</SubIndex><BitLen>8</BitLen>
            <Name>More</Name><DataType>SINT</DataType></Entry>
        </TxPdo>
        <Mailbox DataLinkLayer="true">
          <CoE SdoInfo="true" PdoAssign="1" PdoConfig="1" CompleteAccess="0"/><FoE/>
        </Mailbox>
        <Dc>
          <OpMode><Name>Synchron</Name><Desc>SM</Desc><AssignActivate>0</AssignActivate></OpMode>
          <OpMode>
            <Name>DC</Name><Desc>Sync0 and 1</Desc><AssignActivate>#x0700</AssignActivate>
            <CycleTimeSync0 Factor="1">0</CycleTimeSync0>
            <ShiftTimeSync0>-125000</ShiftTimeSync0>
            <CycleTimeSync1 Factor="#xFFFE">0</CycleTimeSync1>
            <ShiftTimeSync1>500</ShiftTimeSync1>
          </OpMode>
        </Dc>
        <Eeprom>
          <ByteSize>1024</ByteSize>
          <ConfigData>080C00000A000000</ConfigData>
          <BootStrap>0010000100120001</BootStrap>
          <Category><CatNo>#x0801</CatNo><Data>0102030405</Data></Category>
        </Eeprom>
      </Device>
      <Device Physics="YY">
        <Type ProductCode="#x00001234" RevisionNo="#x00010000">AX2</Type>
        <Name>Axis, first revision</Name>
      </Device>
      <Device Physics="K">
        <Type ProductCode="#x00005678" RevisionNo="1">DI4</Type>
        <Name>4 inputs</Name>
        <Fmmu>Inputs</Fmmu>
        <Sm StartAddress="#x1000" ControlByte="#x00" Enable="1">Inputs</Sm>
        <TxPdo Sm="0" Fixed="1" Mandatory="1">
          <Index>#x1A00</Index><Name>Channels</Name>
          <Entry><Index>#x6000</Index><SubIndex>1</SubIndex><BitLen>1</BitLen>
            <Name>Input</Name><DataType>BOOL</DataType></Entry>
        </TxPdo>
        <Eeprom><ByteSize>2048</ByteSize><ConfigData>0401</ConfigData></Eeprom>
      </Device>
    </Devices>
  </Descriptions>
</EtherCATInfo>
"""
