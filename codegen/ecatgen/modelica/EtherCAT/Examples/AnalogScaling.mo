within EtherCAT.Examples;
model AnalogScaling "From raw values to volts, and back"
  extends Modelica.Icons.Example;

  inner EtherCAT.EtherCATMaster etherCATMaster(waitForBus = true)
    "Connection to the bus, which paces the model"
    annotation (Placement(transformation(extent = {{-80, 60}, {-60, 80}})));
  EtherCAT.Examples.Utilities.EL3008 el3008 "8 analog inputs with raw values"
    annotation (Placement(transformation(extent = {{-80, 10}, {-60, 30}})));
  EtherCAT.Conversions.RawToReal toVolts[8](
    each range = EtherCAT.Conversions.Ranges.voltage10V) "Voltages of all channels"
    annotation (Placement(transformation(extent = {{-20, 10}, {0, 30}})));
  EtherCAT.Interfaces.VoltageOutput v[8] "Measured voltages"
    annotation (Placement(transformation(extent = {{100, 10}, {120, 30}})));
  Modelica.Blocks.Sources.Sine wanted(amplitude = 12, f = 1) "Voltage that is too large at times"
    annotation (Placement(transformation(extent = {{-80, -60}, {-60, -40}})));
  EtherCAT.Conversions.RealToRaw toRaw(range = EtherCAT.Conversions.Ranges.voltage10V)
    "Raw value for an analog output"
    annotation (Placement(transformation(extent = {{-20, -60}, {0, -40}})));
  EtherCAT.Conversions.RawToReal back(range = EtherCAT.Conversions.Ranges.voltage10V)
    "Voltage at this output"
    annotation (Placement(transformation(extent = {{40, -60}, {60, -40}})));
equation
  connect(el3008.y, toVolts.u)
    annotation (Line(points = {{-59, 20}, {-22, 20}}, color = {255, 127, 0}));
  connect(toVolts.y, v)
    annotation (Line(points = {{1, 20}, {110, 20}}, color = {0, 0, 127}));
  connect(wanted.y, toRaw.u)
    annotation (Line(points = {{-59, -50}, {-22, -50}}, color = {0, 0, 127}));
  connect(toRaw.y, back.u)
    annotation (Line(points = {{1, -50}, {38, -50}}, color = {255, 127, 0}));

  annotation (
    experiment(StopTime = 5, Interval = 0.001),
    Documentation(info = "<html>
<p>
Start <code>ecatd --simulate troll</code>, simulate, and plot
</p>
<ul>
<li><code>el3008.y[4]</code> and <code>v[4]</code>: a sine of 0.4&nbsp;Hz with an amplitude of 26214
digits, which is 8&nbsp;V;</li>
<li><code>wanted.y</code>, <code>back.y</code> and <code>toRaw.saturated</code>: 12&nbsp;V are beyond the
range, so the output stays at 10&nbsp;V, and <code>saturated</code> is true then.</li>
</ul>
<p>
The rig has no analog outputs; to drive one, connect <code>toRaw.y</code> to its block. Blocks that were
generated with device profiles have volts at their connectors, and need no conversion.
</p>
</html>"));
end AnalogScaling;
