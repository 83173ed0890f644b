within EtherCAT.Examples;
model ReadObject "Read the device type of slave 0 through its mailbox"
  extends Modelica.Icons.Example;

  inner EtherCAT.EtherCATMaster etherCATMaster(waitForBus = true)
    "Connection to the bus, which paces the model"
    annotation (Placement(transformation(extent = {{-60, 40}, {-40, 60}})));
  Modelica.Blocks.Sources.BooleanPulse trigger(period = 0.5)
    "Asks twice in a second"
    annotation (Placement(transformation(extent = {{-60, -4}, {-40, 16}})));
  EtherCAT.SDORead deviceType(
    index = 4096,
    dataType = EtherCAT.Types.DataType.UNSIGNED32)
    "Object 0x1000"
    annotation (Placement(transformation(extent = {{0, -10}, {20, 10}})));
equation
  connect(trigger.y, deviceType.trigger)
    annotation (Line(points = {{-39, 6}, {-2, 6}}, color = {255, 0, 255}));

  annotation (
    experiment(StopTime = 2, Interval = 0.001),
    Documentation(info = "<html>
<p>
Plot <code>deviceType.y</code>: 131474 (0x20192) is a servo drive with the profile CiA&nbsp;402. A slave
without mailbox leaves an abort code instead.
</p>
</html>"));
end ReadObject;
