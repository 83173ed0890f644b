within EtherCAT.Examples.Utilities;
block EL1018 "8 digital inputs 24 V, written by hand"
  extends EtherCAT.Icons.Terminal;
  extends EtherCAT.Interfaces.PartialSlave(
    slaveData(
      position = 2,
      vendorID = 2,
      productCode = 66728018,
      revisionNumber = 0),
    hwName = "EL1018");

  Modelica.Blocks.Interfaces.BooleanOutput y[8](each start = false, each fixed = true) "Channels 1 to 8"
    annotation (Placement(transformation(extent = {{100, -10}, {120, 10}})));
protected
  parameter EtherCAT.Objects.PDO channel1 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24576, 1, false, 1, 1) "0x6000:01";
  parameter EtherCAT.Objects.PDO channel2 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24592, 1, false, 1, 1) "0x6010:01";
  parameter EtherCAT.Objects.PDO channel3 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24608, 1, false, 1, 1) "0x6020:01";
  parameter EtherCAT.Objects.PDO channel4 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24624, 1, false, 1, 1) "0x6030:01";
  parameter EtherCAT.Objects.PDO channel5 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24640, 1, false, 1, 1) "0x6040:01";
  parameter EtherCAT.Objects.PDO channel6 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24656, 1, false, 1, 1) "0x6050:01";
  parameter EtherCAT.Objects.PDO channel7 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24672, 1, false, 1, 1) "0x6060:01";
  parameter EtherCAT.Objects.PDO channel8 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24688, 1, false, 1, 1) "0x6070:01";
equation
  when sampled then
    y = {
      EtherCAT.Functions.readBoolean(channel1, time, etherCATMaster.cycle),
      EtherCAT.Functions.readBoolean(channel2, time, etherCATMaster.cycle),
      EtherCAT.Functions.readBoolean(channel3, time, etherCATMaster.cycle),
      EtherCAT.Functions.readBoolean(channel4, time, etherCATMaster.cycle),
      EtherCAT.Functions.readBoolean(channel5, time, etherCATMaster.cycle),
      EtherCAT.Functions.readBoolean(channel6, time, etherCATMaster.cycle),
      EtherCAT.Functions.readBoolean(channel7, time, etherCATMaster.cycle),
      EtherCAT.Functions.readBoolean(channel8, time, etherCATMaster.cycle)};
  end when;

  annotation (
    defaultComponentName = "el1018",
    Documentation(info = "<html>
<p>
The shortest block that reads. It gives <a href=\"modelica://EtherCAT.Interfaces.PartialSlave\">PartialSlave</a>
the position and the identity of its slave, has an external object
<a href=\"modelica://EtherCAT.Objects.PDO\">PDO</a> for each entry (index, subindex, CoE data type 1 = BOOLEAN,
1 bit), and reads all entries in one when-equation.
<code>etherCATMaster.cycle</code> is the last argument of each read, so that the tool reads after the
sample was taken.
</p>
<p>
In the simulated rig <code>troll</code> channels 1 to 4 are wired to channels 1 to 4 of the EL2008, and
channels 5 to 8 blink with 1, 2, 5 and 10&nbsp;Hz.
</p>
</html>"));
end EL1018;
