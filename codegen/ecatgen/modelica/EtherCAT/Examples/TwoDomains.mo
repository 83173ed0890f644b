within EtherCAT.Examples;
model TwoDomains "Slaves that are sampled at 1 kHz and others at 250 Hz"
  extends Modelica.Icons.Example;

  inner EtherCAT.EtherCATMaster etherCATMaster(
    waitForBus = true,
    sampleTime = {0.001, 0.004})
    "Connection to the bus; domain 1 is sampled at 1 kHz, domain 2 at 250 Hz"
    annotation (Placement(transformation(extent = {{-80, 60}, {-60, 80}})));
  EtherCAT.Examples.Utilities.EL3008 fast(domainID = 1) "Sines of 0.1 Hz to 0.8 Hz, every 1 ms"
    annotation (Placement(transformation(extent = {{-80, 10}, {-60, 30}})));
  EtherCAT.Conversions.RawToReal toVolts(range = EtherCAT.Conversions.Ranges.voltage10V)
    "Voltage of channel 8"
    annotation (Placement(transformation(extent = {{-40, 10}, {-20, 30}})));
  Modelica.Blocks.Math.Gain controller(k = 0.5) "Computes all the time"
    annotation (Placement(transformation(extent = {{0, 10}, {20, 30}})));
  EtherCAT.Conversions.RealToRaw slowValue(
    domainID = 2,
    range = EtherCAT.Conversions.Ranges.voltage10V) "Raw value for a slow slave, every 4 ms"
    annotation (Placement(transformation(extent = {{40, 10}, {60, 30}})));
  EtherCAT.Examples.Utilities.EL1018 slow(domainID = 2) "Digital inputs, every 4 ms"
    annotation (Placement(transformation(extent = {{-80, -40}, {-60, -20}})));
  EtherCAT.Conversions.BooleansToInteger word "All inputs as one number"
    annotation (Placement(transformation(extent = {{-40, -40}, {-20, -20}})));
equation
  connect(fast.y[8], toVolts.u)
    annotation (Line(points = {{-59, 20}, {-42, 20}}, color = {255, 127, 0}));
  connect(toVolts.y, controller.u)
    annotation (Line(points = {{-19, 20}, {-2, 20}}, color = {0, 0, 127}));
  connect(controller.y, slowValue.u)
    annotation (Line(points = {{21, 20}, {38, 20}}, color = {0, 0, 127}));
  connect(slow.y, word.u)
    annotation (Line(points = {{-59, -30}, {-42, -30}}, color = {255, 0, 255}));

  annotation (
    experiment(StopTime = 6, Interval = 0.001),
    Documentation(info = "<html>
<p>
In the testbed of the paper on the DLR EtherCAT library the drive is controlled at 1000&nbsp;Hz, while the robot
gets data in every fourth sample, at 250&nbsp;Hz. <code>sampleTime</code> of the master has one element
for each such domain, and each block chooses one by <code>domainID</code>.
</p>
<p>
Start <code>ecatd --simulate troll</code>, simulate, and plot <code>fast.y[8]</code> and
<code>slowValue.y</code> over some hundredths of a second: one may change in every sample, each 1&nbsp;ms, the other one every
4&nbsp;ms. <code>word.y</code> changes at multiples of 4&nbsp;ms only. At an instant of both domains all
blocks see the same bus cycle.
</p>
<p>
These are domains of the model: the bus exchanges everything in each of its cycles. Domains of the bus,
which save frames, are configured in the daemon.
</p>
</html>"));
end TwoDomains;
