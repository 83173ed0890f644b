within EtherCAT.Examples;
model ReadObject "Read and write objects of a drive through its mailbox"
  extends Modelica.Icons.Example;

  inner EtherCAT.EtherCATMaster etherCATMaster(waitForBus = true)
    "Connection to the bus, which paces the model"
    annotation (Placement(transformation(extent = {{-80, 40}, {-60, 60}})));
  Modelica.Blocks.Sources.BooleanPulse twiceInASecond(period = 0.5) "Asks for the device type"
    annotation (Placement(transformation(extent = {{-80, -4}, {-60, 16}})));
  EtherCAT.SDORead deviceType(
    object = "0x1000:00",
    dataType = EtherCAT.Types.DataType.UNSIGNED32) "Integer, when triggered"
    annotation (Placement(transformation(extent = {{-20, -10}, {0, 10}})));
  EtherCAT.SDOReadReal voltage(
    object = "0x6079:00",
    dataType = EtherCAT.Types.DataType.UNSIGNED32,
    scale = 0.001,
    unit = "V",
    request = EtherCAT.Types.Request.Sampled,
    period = 0.1) "DC link voltage, which the drive has in mV: Real, ten times in a second"
    annotation (Placement(transformation(extent = {{40, -10}, {60, 10}})));
  EtherCAT.SDOReadString deviceName(
    object = "0x1008:00",
    request = EtherCAT.Types.Request.Initial) "String, once at the start"
    annotation (Placement(transformation(extent = {{40, 40}, {60, 60}})));
  Modelica.Blocks.Sources.IntegerConstant timeOut(k = 10) "Time in ms"
    annotation (Placement(transformation(extent = {{-80, -66}, {-60, -46}})));
  EtherCAT.SDOWrite write(
    object = "0x6066:00",
    dataType = EtherCAT.Types.DataType.UNSIGNED16,
    request = EtherCAT.Types.Request.Initial) "Following error time out, once at the start"
    annotation (Placement(transformation(extent = {{-20, -60}, {0, -40}})));
  EtherCAT.SDORead readBack(
    object = "0x6066:00",
    dataType = EtherCAT.Types.DataType.UNSIGNED16) "The same object, when it is written"
    annotation (Placement(transformation(extent = {{40, -60}, {60, -40}})));
equation
  connect(twiceInASecond.y, deviceType.trigger)
    annotation (Line(points = {{-59, 6}, {-22, 6}}, color = {255, 0, 255}));
  connect(timeOut.y, write.u)
    annotation (Line(points = {{-59, -56}, {-22, -56}}, color = {255, 127, 0}));
  connect(write.done, readBack.trigger)
    annotation (Line(points = {{1, -47}, {20, -47}, {20, -44}, {38, -44}}, color = {255, 0, 255}));

  annotation (
    experiment(StopTime = 2, Interval = 0.001),
    Documentation(info = "<html>
<p>
Start <code>ecatd --simulate troll</code> and simulate. Slave 0 is a servo drive there; on another bus the
requests may fail, and leave an abort code and a text instead.
</p>
<table border=\"1\" cellspacing=\"0\" cellpadding=\"2\">
<tr><th>block</th><th>requested</th><th>shows</th></tr>
<tr><td><code>deviceType</code></td><td>when triggered</td><td>131474 (0x20192), a servo drive with the
profile CiA&nbsp;402</td></tr>
<tr><td><code>voltage</code></td><td>every 0.1&nbsp;s</td><td>the DC link voltage, 48&nbsp;V</td></tr>
<tr><td><code>deviceName</code></td><td>once</td><td>the name; it is a String, which some tools do not plot but
list among the variables</td></tr>
<tr><td><code>write</code></td><td>once</td><td><code>done</code>, when the drive has accepted the
value</td></tr>
<tr><td><code>readBack</code></td><td>then</td><td>10, the value that was written</td></tr>
</table>
</html>"));
end ReadObject;
