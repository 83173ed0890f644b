within EtherCAT.Drives;
block Elmo "Elmo Gold drive with its state machine, in SI units"
  extends EtherCAT.Interfaces.PartialDrive(
    cia402(final position = position, final slaveName = slaveName));

  parameter String slaveName = ""
    "Name of the drive in the configuration of ecatd; if empty, its position below"
    annotation (Dialog(group = "Operation"));
  parameter Integer position(min = 0) = 0 "Position of the drive on the bus, 0 first"
    annotation (Dialog(group = "Operation", enable = slaveName == ""));

  EtherCAT.Drives.Utilities.ElmoGold slave(
    final domainID = domainID,
    slaveData(final position = position, final name = slaveName)) "Process data of the drive"
    annotation (Placement(transformation(extent = {{-56, -128}, {56, -72}})));
equation
  connect(cia402.modeOfOperation, slave.modeOfOperation)
    annotation (Line(points = {{-140, -35}, {-140, -124}, {-58, -124}}, color = {255, 127, 0}));
  connect(cia402.controlWord, slave.controlWord)
    annotation (Line(points = {{-129, -35}, {-129, -116}, {-58, -116}}, color = {255, 127, 0}));
  connect(cia402.maxTorque, slave.maxTorque)
    annotation (Line(points = {{-118, -35}, {-118, -108}, {-58, -108}}, color = {255, 127, 0}));
  connect(cia402.targetTorque, slave.targetTorque)
    annotation (Line(points = {{-107, -35}, {-107, -100}, {-58, -100}}, color = {255, 127, 0}));
  connect(cia402.targetVelocity, slave.targetVelocity)
    annotation (Line(points = {{-96, -35}, {-96, -92}, {-58, -92}}, color = {255, 127, 0}));
  connect(cia402.targetPosition, slave.targetPosition)
    annotation (Line(points = {{-85, -35}, {-85, -84}, {-58, -84}}, color = {255, 127, 0}));
  connect(slave.valid, cia402.valid)
    annotation (Line(points = {{58, -76}, {74, -76}, {74, -35}}, color = {255, 0, 255}));
  connect(slave.positionActualValue, cia402.positionActualValue)
    annotation (Line(points = {{58, -84}, {85, -84}, {85, -35}}, color = {255, 127, 0}));
  connect(slave.torqueActualValue, cia402.torqueActualValue)
    annotation (Line(points = {{58, -92}, {96, -92}, {96, -35}}, color = {255, 127, 0}));
  connect(slave.statusWord, cia402.statusWord)
    annotation (Line(points = {{58, -100}, {107, -100}, {107, -35}}, color = {255, 127, 0}));
  connect(slave.modeOfOperationDisplay, cia402.modeOfOperationDisplay)
    annotation (Line(points = {{58, -108}, {118, -108}, {118, -35}}, color = {255, 127, 0}));
  connect(slave.velocityActualValue, cia402.velocityActualValue)
    annotation (Line(points = {{58, -116}, {129, -116}, {129, -35}}, color = {255, 127, 0}));
  connect(slave.currentActualValue, cia402.currentActualValue)
    annotation (Line(points = {{58, -124}, {140, -124}, {140, -35}}, color = {255, 127, 0}));

  annotation (
    defaultComponentName = "elmo",
    Documentation(info = "<html>
<p>
The interface model of the paper on the DLR EtherCAT library (Figure&nbsp;7): the block of the slave, the
state machine that leads it into operation, and the conversions of its inputs and outputs, as one block
that needs no generated library. The drive needs the process data RPDO6 (0x1605), TPDO3 (0x1A02), 0x1A11 and
0x1A1F: the defaults of the simulated rig <code>troll</code>. For a drive with other process data, take the
block from the generated library of the bus.
</p>
<p>
<a href=\"modelica://EtherCAT.Drives.CiA402\">CiA402</a> explains connectors and parameters. Positions of this
drive are increments of its encoder, speeds increments per second. Set
<code>encoderResolution</code>, <code>ratedTorque</code> and <code>ratedCurrent</code> to the data of the motor:
the drive has them in its objects 0x608F, 0x6076 (in mN.m) and 0x6075 (in mA).
</p>
</html>"),
    Icon(graphics = {Text(extent = {{-90, 98}, {90, 74}}, textString = "Elmo", textStyle = {TextStyle.Bold})}),
    Diagram(coordinateSystem(extent = {{-220, -160}, {220, 130}})));
end Elmo;
