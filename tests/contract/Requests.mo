within ;
model Requests "All SDO blocks on the rig of the tests"
  inner EtherCAT.EtherCATMaster etherCATMaster(waitForBus = true);
  EtherCAT.SDOWrite writeInteger(
    object = "0x2004:00",
    dataType = EtherCAT.Types.DataType.INTEGER32,
    request = EtherCAT.Types.Request.Initial,
    u = -42);
  EtherCAT.SDORead readInteger(index = 8196, dataType = EtherCAT.Types.DataType.INTEGER32);
  EtherCAT.SDOWriteReal writeReal(
    object = "0x201B",
    dataType = EtherCAT.Types.DataType.UNSIGNED64,
    scale = 0.5,
    unit = "V",
    u = 3e15);
  Modelica.Blocks.Sources.BooleanConstant trigger;
  EtherCAT.SDOReadReal readReal(
    object = "0x201B",
    dataType = EtherCAT.Types.DataType.UNSIGNED64,
    scale = 0.5,
    unit = "V",
    request = EtherCAT.Types.Request.Sampled,
    period = 0.05);
  EtherCAT.SDOWriteString writeString(
    object = "0x2200",
    dataType = EtherCAT.Types.DataType.OCTET_STRING,
    request = EtherCAT.Types.Request.Initial,
    u = "caf\\xE9");
  EtherCAT.SDOReadString readString(
    object = "0x2200",
    request = EtherCAT.Types.Request.Sampled,
    period = 0.05);
  EtherCAT.SDOReadString refused(object = "0x5FFF", request = EtherCAT.Types.Request.Initial);
  parameter EtherCAT.Objects.StartupList list = EtherCAT.Objects.StartupList(
    etherCATMaster.master, 0, "", [8194, 0, 2, -5; 8195, 0, 3, 6]) "An INTEGER8 and an INTEGER16";
  Integer listState(start = 0, fixed = true);
equation
  connect(writeInteger.done, readInteger.trigger);
  connect(trigger.y, writeReal.trigger);
  when etherCATMaster.sampled[1] then
    listState = EtherCAT.Functions.startupListWrite(list, time, etherCATMaster.cycle, true);
  end when;
end Requests;
