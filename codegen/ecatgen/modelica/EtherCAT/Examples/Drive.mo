within EtherCAT.Examples;
model Drive "A point-to-point movement of the drive of the rig troll"
  extends Modelica.Icons.Example;

  inner EtherCAT.EtherCATMaster etherCATMaster(waitForBus = true)
    "Connection to the bus, which paces the model"
    annotation (Placement(transformation(extent = {{-80, 60}, {-60, 80}})));
  Modelica.Blocks.Sources.BooleanConstant enable(k = true) "The drive shall be in operation"
    annotation (Placement(transformation(extent = {{-80, 5}, {-60, 25}})));
  EtherCAT.Sources.PointToPoint ptp(
    distance = 471.24,
    maxSpeed = 62.83,
    maxAcceleration = 125.66,
    startTime = 1) "Reference speed: 75 revolutions, at most 10 in a second"
    annotation (Placement(transformation(extent = {{-80, -40}, {-60, -20}})));
  EtherCAT.Drives.Elmo drive(
    encoderResolution = 65536,
    ratedTorque = 0.4,
    ratedCurrent = 5) "Drive at position 0"
    annotation (Placement(transformation(extent = {{5, -25}, {55, 25}})));
equation
  connect(enable.y, drive.enable)
    annotation (Line(points = {{-59, 15}, {2, 15}}, color = {255, 0, 255}));
  connect(ptp.y, drive.w_ref)
    annotation (Line(points = {{-59, -30}, {-40, -30}, {-40, -13}, {2, -13}}, color = {0, 0, 127}));

  annotation (
    experiment(StopTime = 10, Interval = 0.001),
    Documentation(info = "<html>
<p>
Simulate the model while <code>ecatd --simulate troll</code> runs, and plot <code>ptp.y</code>,
<code>drive.w</code> and <code>drive.i</code>: Figures&nbsp;8 and&nbsp;9 of the paper on the DLR EtherCAT
library. Until <code>drive.enabled</code> is true the drive does not follow the reference.
</p>
<p>
Before you simulate it with real hardware, set <code>encoderResolution</code>, <code>ratedTorque</code>,
<code>ratedCurrent</code> and the movement to values that suit the motor and its load.
</p>
</html>"));
end Drive;
