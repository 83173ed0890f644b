within EtherCAT.Examples.Utilities;
block EL2008 "8 digital outputs 24 V, written by hand"
  extends EtherCAT.Icons.Terminal;
  extends EtherCAT.Interfaces.PartialSlave(
    slaveData(
      position = 3,
      vendorID = 2,
      productCode = 131608658,
      revisionNumber = 0),
    hwName = "EL2008");

  Modelica.Blocks.Interfaces.BooleanInput u[8] "Channels 1 to 8"
    annotation (Placement(transformation(extent = {{-140, -20}, {-100, 20}})));
protected
  parameter EtherCAT.Objects.PDO channel1 = EtherCAT.Objects.PDO(
    slaveConfiguration, 28672, 1, true, 1, 1) "0x7000:01";
  parameter EtherCAT.Objects.PDO channel2 = EtherCAT.Objects.PDO(
    slaveConfiguration, 28688, 1, true, 1, 1) "0x7010:01";
  parameter EtherCAT.Objects.PDO channel3 = EtherCAT.Objects.PDO(
    slaveConfiguration, 28704, 1, true, 1, 1) "0x7020:01";
  parameter EtherCAT.Objects.PDO channel4 = EtherCAT.Objects.PDO(
    slaveConfiguration, 28720, 1, true, 1, 1) "0x7030:01";
  parameter EtherCAT.Objects.PDO channel5 = EtherCAT.Objects.PDO(
    slaveConfiguration, 28736, 1, true, 1, 1) "0x7040:01";
  parameter EtherCAT.Objects.PDO channel6 = EtherCAT.Objects.PDO(
    slaveConfiguration, 28752, 1, true, 1, 1) "0x7050:01";
  parameter EtherCAT.Objects.PDO channel7 = EtherCAT.Objects.PDO(
    slaveConfiguration, 28768, 1, true, 1, 1) "0x7060:01";
  parameter EtherCAT.Objects.PDO channel8 = EtherCAT.Objects.PDO(
    slaveConfiguration, 28784, 1, true, 1, 1) "0x7070:01";
  Integer written1(start = 0, fixed = true) "Comes after the sample";
  Integer written2(start = 0, fixed = true) "Comes after written1";
  Integer written3(start = 0, fixed = true) "Comes after written2";
  Integer written4(start = 0, fixed = true) "Comes after written3";
  Integer written5(start = 0, fixed = true) "Comes after written4";
  Integer written6(start = 0, fixed = true) "Comes after written5";
  Integer written7(start = 0, fixed = true) "Comes after written6";
  Integer written8(start = 0, fixed = true) "Comes after written7";
  Integer committed(start = 0, fixed = true) "The end of the chain";
equation
  when sampled then
    written1 = EtherCAT.Functions.writeBoolean(channel1, time, etherCATMaster.cycle, u[1]);
    written2 = EtherCAT.Functions.writeBoolean(channel2, time, written1, u[2]);
    written3 = EtherCAT.Functions.writeBoolean(channel3, time, written2, u[3]);
    written4 = EtherCAT.Functions.writeBoolean(channel4, time, written3, u[4]);
    written5 = EtherCAT.Functions.writeBoolean(channel5, time, written4, u[5]);
    written6 = EtherCAT.Functions.writeBoolean(channel6, time, written5, u[6]);
    written7 = EtherCAT.Functions.writeBoolean(channel7, time, written6, u[7]);
    written8 = EtherCAT.Functions.writeBoolean(channel8, time, written7, u[8]);
    committed = EtherCAT.Functions.commit(slaveConfiguration, time, written8);
  end when;

  annotation (
    defaultComponentName = "el2008",
    Documentation(info = "<html>
<p>
The shortest block that writes. A tool may evaluate equations in any order that their variables allow. To
fix the order of the calls, the argument before the value of each write is the result of the write before,
and the commit takes the result of the last write. So all channels of a sample leave together.
</p>
<p>
A block that reads <em>and</em> writes does so in two when-equations: in one, the outputs would depend on
the inputs, and a controller between them would close a loop.
</p>
</html>"));
end EL2008;
