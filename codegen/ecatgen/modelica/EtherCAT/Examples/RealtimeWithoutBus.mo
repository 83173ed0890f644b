within EtherCAT.Examples;
model RealtimeWithoutBus "Run a model in real time, then half as fast, without any bus"
  extends Modelica.Icons.Example;

  EtherCAT.SynchronizeRealtime synchronizeRealtime(enableRealTimeScaling = true)
    "Holds the simulation back to the pace of the clock"
    annotation (Placement(transformation(extent = {{0, 30}, {20, 50}})));
  Modelica.Blocks.Sources.Step scaling(height = 1, offset = 1, startTime = 2)
    "1: real time, 2: two seconds for one of simulation time"
    annotation (Placement(transformation(extent = {{-60, 30}, {-40, 50}})));
  Modelica.Blocks.Sources.Sine reference(amplitude = 1, f = 1) "Signal that the filter follows"
    annotation (Placement(transformation(extent = {{-60, -50}, {-40, -30}})));
  Modelica.Blocks.Continuous.FirstOrder follower(
    k = 1,
    T = 0.1,
    initType = Modelica.Blocks.Types.Init.InitialState,
    y_start = 0) "Filter that stands for a model"
    annotation (Placement(transformation(extent = {{0, -50}, {20, -30}})));
equation
  connect(scaling.y, synchronizeRealtime.scaling)
    annotation (Line(points = {{-39, 40}, {-2, 40}}, color = {0, 0, 127}));
  connect(reference.y, follower.u)
    annotation (Line(points = {{-39, -40}, {-2, -40}}, color = {0, 0, 127}));

  annotation (
    experiment(StopTime = 4, Interval = 0.001),
    Documentation(info = "<html>
<p>
Needs neither a bus nor the daemon. The simulation of 4&nbsp;s takes 6&nbsp;s: the first half runs in real
time, the second one half as fast.
</p>
<p>
Plot <code>follower.y</code> while it runs; then <code>synchronizeRealtime.availableTime</code> (1&nbsp;ms,
later 2&nbsp;ms), <code>calculationTime</code>, which is much less, and <code>lateness</code> and
<code>missed</code>, which show how often the machine was too slow for the model.
</p>
</html>"));
end RealtimeWithoutBus;
