within EtherCAT.Examples.Utilities;
block EL3008 "8 analog inputs -10 V to 10 V, written by hand"
  extends EtherCAT.Icons.Terminal;
  extends EtherCAT.Interfaces.PartialSlave(
    slaveData(
      position = 4,
      vendorID = 2,
      productCode = 197144658,
      revisionNumber = 0),
    hwName = "EL3008");

  Modelica.Blocks.Interfaces.IntegerOutput y[8](each start = 0, each fixed = true) "Raw values of channels 1 to 8, 32767 is 10 V"
    annotation (Placement(transformation(extent = {{100, -10}, {120, 10}})));
protected
  parameter EtherCAT.Objects.PDO channel1 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24576, 17, false, 3, 16) "0x6000:11";
  parameter EtherCAT.Objects.PDO channel2 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24592, 17, false, 3, 16) "0x6010:11";
  parameter EtherCAT.Objects.PDO channel3 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24608, 17, false, 3, 16) "0x6020:11";
  parameter EtherCAT.Objects.PDO channel4 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24624, 17, false, 3, 16) "0x6030:11";
  parameter EtherCAT.Objects.PDO channel5 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24640, 17, false, 3, 16) "0x6040:11";
  parameter EtherCAT.Objects.PDO channel6 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24656, 17, false, 3, 16) "0x6050:11";
  parameter EtherCAT.Objects.PDO channel7 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24672, 17, false, 3, 16) "0x6060:11";
  parameter EtherCAT.Objects.PDO channel8 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24688, 17, false, 3, 16) "0x6070:11";
equation
  when sampled then
    y = {
      EtherCAT.Functions.readInteger(channel1, time, etherCATMaster.cycle),
      EtherCAT.Functions.readInteger(channel2, time, etherCATMaster.cycle),
      EtherCAT.Functions.readInteger(channel3, time, etherCATMaster.cycle),
      EtherCAT.Functions.readInteger(channel4, time, etherCATMaster.cycle),
      EtherCAT.Functions.readInteger(channel5, time, etherCATMaster.cycle),
      EtherCAT.Functions.readInteger(channel6, time, etherCATMaster.cycle),
      EtherCAT.Functions.readInteger(channel7, time, etherCATMaster.cycle),
      EtherCAT.Functions.readInteger(channel8, time, etherCATMaster.cycle)};
  end when;

  annotation (
    defaultComponentName = "el3008",
    Documentation(info = "<html>
<p>
Like <a href=\"modelica://EtherCAT.Examples.Utilities.EL1018\">EL1018</a>, with entries of CoE data type 3
(INTEGER16) and 16 bits. The values are raw; see
<a href=\"modelica://EtherCAT.Examples.AnalogScaling\">AnalogScaling</a> for what to do with them. The
alternative is to give <code>PDO</code> a scale of <code>10/32767</code> and to read by
<code>readReal</code>: then the block has volts, as those that are generated with a device profile.
</p>
<p>
In the simulated rig <code>troll</code> slave 4 measures sines of 8&nbsp;V with 0.1 to 0.8&nbsp;Hz, slave 5 the
constants -8, -4, -1, 0, 1, 4, 8 and 10&nbsp;V.
</p>
</html>"));
end EL3008;
