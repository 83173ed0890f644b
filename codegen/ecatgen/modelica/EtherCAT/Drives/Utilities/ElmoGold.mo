within EtherCAT.Drives.Utilities;
block ElmoGold "Elmo Gold drive with the process data RPDO6, TPDO3, 0x1A11 and 0x1A1F"
  extends EtherCAT.Interfaces.PartialSlave(
    slaveData(
      position = 0,
      vendorID = 154,
      productCode = 198948,
      revisionNumber = 0),
    hwName = "Elmo Gold",
    generateCommand = "ecatctl generate NAME DIR, and take the drive of that library");

  Modelica.Blocks.Interfaces.IntegerInput targetPosition
    "RPDO6 Mapping: Target Position (0x607A:00)"
    annotation (Placement(transformation(extent = {{-480, 30}, {-460, 50}})));
  Modelica.Blocks.Interfaces.IntegerInput targetVelocity
    "RPDO6 Mapping: Target Velocity (0x60FF:00)"
    annotation (Placement(transformation(extent = {{-480, -10}, {-460, 10}})));
  Modelica.Blocks.Interfaces.IntegerInput targetTorque
    "RPDO6 Mapping: Target Torque (0x6071:00)"
    annotation (Placement(transformation(extent = {{-480, -50}, {-460, -30}})));
  Modelica.Blocks.Interfaces.IntegerInput maxTorque
    "RPDO6 Mapping: Max torque (0x6072:00)"
    annotation (Placement(transformation(extent = {{-480, -90}, {-460, -70}})));
  Modelica.Blocks.Interfaces.IntegerInput controlWord
    "RPDO6 Mapping: Control word (0x6040:00)"
    annotation (Placement(transformation(extent = {{-480, -130}, {-460, -110}})));
  Modelica.Blocks.Interfaces.IntegerInput modeOfOperation
    "RPDO6 Mapping: Mode of operation (0x6060:00)"
    annotation (Placement(transformation(extent = {{-480, -170}, {-460, -150}})));
  Modelica.Blocks.Interfaces.IntegerOutput positionActualValue(start = 0, fixed = true)
    "TPDO3 Mapping: Position actual value (0x6064:00)"
    annotation (Placement(transformation(extent = {{100, 30}, {120, 50}})));
  Modelica.Blocks.Interfaces.IntegerOutput torqueActualValue(start = 0, fixed = true)
    "TPDO3 Mapping: Torque actual value (0x6077:00)"
    annotation (Placement(transformation(extent = {{100, -10}, {120, 10}})));
  Modelica.Blocks.Interfaces.IntegerOutput statusWord(start = 0, fixed = true)
    "TPDO3 Mapping: Status word (0x6041:00)"
    annotation (Placement(transformation(extent = {{100, -50}, {120, -30}})));
  Modelica.Blocks.Interfaces.IntegerOutput modeOfOperationDisplay(start = 0, fixed = true)
    "TPDO3 Mapping: Mode of operation display (0x6061:00)"
    annotation (Placement(transformation(extent = {{100, -90}, {120, -70}})));
  Modelica.Blocks.Interfaces.IntegerOutput velocityActualValue(start = 0, fixed = true)
    "Velocity actual value (0x606C:00)"
    annotation (Placement(transformation(extent = {{100, -130}, {120, -110}})));
  Modelica.Blocks.Interfaces.IntegerOutput currentActualValue(start = 0, fixed = true)
    "Current actual value (0x6078:00)"
    annotation (Placement(transformation(extent = {{100, -170}, {120, -150}})));
protected
  parameter EtherCAT.Objects.PDO output_607A_00 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24698, 0, true, 4, 32) "0x607A:00";
  parameter EtherCAT.Objects.PDO output_60FF_00 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24831, 0, true, 4, 32) "0x60FF:00";
  parameter EtherCAT.Objects.PDO output_6071_00 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24689, 0, true, 3, 16) "0x6071:00";
  parameter EtherCAT.Objects.PDO output_6072_00 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24690, 0, true, 6, 16) "0x6072:00";
  parameter EtherCAT.Objects.PDO output_6040_00 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24640, 0, true, 6, 16) "0x6040:00";
  parameter EtherCAT.Objects.PDO output_6060_00 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24672, 0, true, 2, 8) "0x6060:00";
  parameter EtherCAT.Objects.PDO input_6064_00 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24676, 0, false, 4, 32) "0x6064:00";
  parameter EtherCAT.Objects.PDO input_6077_00 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24695, 0, false, 3, 16) "0x6077:00";
  parameter EtherCAT.Objects.PDO input_6041_00 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24641, 0, false, 6, 16) "0x6041:00";
  parameter EtherCAT.Objects.PDO input_6061_00 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24673, 0, false, 2, 8) "0x6061:00";
  parameter EtherCAT.Objects.PDO input_606C_00 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24684, 0, false, 4, 32) "0x606C:00";
  parameter EtherCAT.Objects.PDO input_6078_00 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24696, 0, false, 3, 16) "0x6078:00";
  Integer written_607A_00(start = 0, fixed = true) "Order of the write of 0x607A:00";
  Integer written_60FF_00(start = 0, fixed = true) "Order of the write of 0x60FF:00";
  Integer written_6071_00(start = 0, fixed = true) "Order of the write of 0x6071:00";
  Integer written_6072_00(start = 0, fixed = true) "Order of the write of 0x6072:00";
  Integer written_6040_00(start = 0, fixed = true) "Order of the write of 0x6040:00";
  Integer written_6060_00(start = 0, fixed = true) "Order of the write of 0x6060:00";
  Integer committed(start = 0, fixed = true) "End of the chain that orders the writes";
equation
  when sampled then
    positionActualValue = EtherCAT.Functions.readInteger(input_6064_00, time, etherCATMaster.cycle);
    torqueActualValue = EtherCAT.Functions.readInteger(input_6077_00, time, etherCATMaster.cycle);
    statusWord = EtherCAT.Functions.readInteger(input_6041_00, time, etherCATMaster.cycle);
    modeOfOperationDisplay = EtherCAT.Functions.readInteger(input_6061_00, time, etherCATMaster.cycle);
    velocityActualValue = EtherCAT.Functions.readInteger(input_606C_00, time, etherCATMaster.cycle);
    currentActualValue = EtherCAT.Functions.readInteger(input_6078_00, time, etherCATMaster.cycle);
  end when;
  when sampled then
    written_607A_00 = EtherCAT.Functions.writeInteger(output_607A_00, time, etherCATMaster.cycle, targetPosition);
    written_60FF_00 = EtherCAT.Functions.writeInteger(output_60FF_00, time, written_607A_00, targetVelocity);
    written_6071_00 = EtherCAT.Functions.writeInteger(output_6071_00, time, written_60FF_00, targetTorque);
    written_6072_00 = EtherCAT.Functions.writeInteger(output_6072_00, time, written_6071_00, maxTorque);
    written_6040_00 = EtherCAT.Functions.writeInteger(output_6040_00, time, written_6072_00, controlWord);
    written_6060_00 = EtherCAT.Functions.writeInteger(output_6060_00, time, written_6040_00, modeOfOperation);
    committed = EtherCAT.Functions.commit(slaveConfiguration, time, written_6060_00);
  end when;

  annotation (
    defaultComponentName = "elmoGold",
    Documentation(info = "<html>
<p>
The block of the slave as it is generated for a bus with an Elmo Gold drive in its default mapping, written by hand
so that <a href=\"modelica://EtherCAT.Drives.Elmo\">Elmo</a> can be used without a generated library. Values are
raw, as in the process data. <code>slaveData.position</code> says where the drive is on the bus.
</p>
</html>"),
    Icon(
      coordinateSystem(preserveAspectRatio = true, extent = {{-460, -180}, {100, 100}}),
      graphics = {
        Rectangle(extent = {{-460, -180}, {100, 100}}, lineColor = {64, 64, 64}, fillColor = {250, 252, 252}, fillPattern = FillPattern.Solid, radius = 6),
        Line(points = {{-460, 60}, {100, 60}}, color = {160, 190, 190}),
        Rectangle(extent = {{-448, 72}, {-428, 90}}, lineColor = {64, 64, 64}, fillColor = {95, 158, 160}, fillPattern = FillPattern.Solid),
        Line(points = {{-445, 76}, {-431, 76}}, color = {64, 64, 64}, thickness = 0.5),
        Line(points = {{-445, 81}, {-431, 81}}, color = {64, 64, 64}, thickness = 0.5),
        Line(points = {{-445, 86}, {-431, 86}}, color = {64, 64, 64}, thickness = 0.5),
        Rectangle(extent = {{-428, 78}, {-418, 84}}, lineColor = {64, 64, 64}, fillColor = {95, 158, 160}, fillPattern = FillPattern.Solid),
        Polygon(points = {{-446, 68}, {-430, 68}, {-432, 72}, {-444, 72}}, lineColor = {64, 64, 64}, fillColor = {95, 158, 160}, fillPattern = FillPattern.Solid),
        Text(extent = {{-408, 64}, {17, 96}}, textColor = {32, 96, 96}, textString = "Elmo Gold", textStyle = {TextStyle.Bold}, horizontalAlignment = TextAlignment.Left),
        Text(extent = {{37, 66}, {90, 94}}, textColor = {96, 96, 96}, textString = "valid", horizontalAlignment = TextAlignment.Right),
        Text(extent = {{-450, 26}, {-293, 54}}, textString = "targetPosition", horizontalAlignment = TextAlignment.Left),
        Text(extent = {{-450, -14}, {-294, 14}}, textString = "targetVelocity", horizontalAlignment = TextAlignment.Left),
        Text(extent = {{-450, -54}, {-303, -26}}, textString = "targetTorque", horizontalAlignment = TextAlignment.Left),
        Text(extent = {{-450, -94}, {-320, -66}}, textString = "maxTorque", horizontalAlignment = TextAlignment.Left),
        Text(extent = {{-450, -134}, {-311, -106}}, textString = "controlWord", horizontalAlignment = TextAlignment.Left),
        Text(extent = {{-450, -174}, {-246, -146}}, textString = "modeOfOperation", horizontalAlignment = TextAlignment.Left),
        Text(extent = {{-136, 26}, {90, 54}}, textString = "positionActualValue", horizontalAlignment = TextAlignment.Right),
        Text(extent = {{-120, -14}, {90, 14}}, textString = "torqueActualValue", horizontalAlignment = TextAlignment.Right),
        Text(extent = {{-40, -54}, {90, -26}}, textString = "statusWord", horizontalAlignment = TextAlignment.Right),
        Text(extent = {{-198, -94}, {90, -66}}, textString = "modeOfOperationDisplay", horizontalAlignment = TextAlignment.Right),
        Text(extent = {{-133, -134}, {90, -106}}, textString = "velocityActualValue", horizontalAlignment = TextAlignment.Right),
        Text(extent = {{-127, -174}, {90, -146}}, textString = "currentActualValue", horizontalAlignment = TextAlignment.Right),
        Text(extent = {{-460, 150}, {100, 110}}, textColor = {0, 0, 255}, textString = "%name")}));
end ElmoGold;
