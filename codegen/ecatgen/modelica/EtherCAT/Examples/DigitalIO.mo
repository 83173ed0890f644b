within EtherCAT.Examples;
model DigitalIO "Write digital outputs and read digital inputs"
  extends Modelica.Icons.Example;

  inner EtherCAT.EtherCATMaster etherCATMaster(waitForBus = true)
    "Connection to the bus, which paces the model"
    annotation (Placement(transformation(extent = {{-80, 40}, {-60, 60}})));
  Modelica.Blocks.Sources.BooleanPulse blink[4](period = {0.4, 0.8, 1.6, 3.2})
    "Counts in binary numbers"
    annotation (Placement(transformation(extent = {{-80, 0}, {-60, 20}})));
  Modelica.Blocks.Sources.BooleanConstant off[4](each k = false) "Channels that are not used"
    annotation (Placement(transformation(extent = {{-80, -40}, {-60, -20}})));
  EtherCAT.Examples.Utilities.EL2008 el2008 "8 digital outputs"
    annotation (Placement(transformation(extent = {{0, -10}, {20, 10}})));
  EtherCAT.Examples.Utilities.EL1018 el1018 "8 digital inputs"
    annotation (Placement(transformation(extent = {{0, -70}, {20, -50}})));
  EtherCAT.Conversions.BooleansToInteger word "All inputs as one number"
    annotation (Placement(transformation(extent = {{60, -70}, {80, -50}})));
equation
  connect(blink.y, el2008.u[1:4])
    annotation (Line(points = {{-59, 10}, {-30, 10}, {-30, 0}, {-2, 0}}, color = {255, 0, 255}));
  connect(off.y, el2008.u[5:8])
    annotation (Line(points = {{-59, -30}, {-30, -30}, {-30, 0}, {-2, 0}}, color = {255, 0, 255}));
  connect(el1018.y, word.u)
    annotation (Line(points = {{21, -60}, {58, -60}}, color = {255, 0, 255}));

  annotation (
    experiment(StopTime = 3, Interval = 0.001),
    Documentation(info = "<html>
<p>
Start <code>ecatd --simulate troll</code>, simulate, and plot <code>blink[1].y</code> and
<code>el1018.y[1]</code>: the rig wires outputs 1 to 4 to inputs 1 to 4, and so the input follows the output
some bus cycles later. Inputs 5 to 8 blink with 1, 2, 5 and 10&nbsp;Hz by themselves.
</p>
<p>
The value of an output of the bus leaves with the cycle after its sample; the simulated terminal sees it
then, and its input is in the sample after that. Between two slaves of a real bus the time constants of
the input filters come on top.
</p>
</html>"));
end DigitalIO;
