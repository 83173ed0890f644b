within EtherCAT;
block SynchronizeRealtime "Pace a model without a bus by the clock of the machine"
  extends EtherCAT.Icons.Clock;

  parameter Modelica.Units.SI.Period sampleTime(min = 1e-6) = 0.001
    "Simulation time between two looks at the clock";
  parameter Boolean setPriority = true "= true, if the priority of the simulation process is set"
    annotation (Evaluate = true, choices(checkBox = true), Dialog(group = "Process"));
  parameter EtherCAT.Types.ProcessPriority priority = EtherCAT.Types.ProcessPriority.Normal
    "Priority of the simulation process"
    annotation (Dialog(group = "Process", enable = setPriority));
  parameter Boolean enable = true "= true, if the model is paced; else it runs as fast as it can"
    annotation (choices(checkBox = true), Dialog(group = "Advanced"));
  parameter Boolean enableRealTimeScaling = false "= true, if the pace has an input connector"
    annotation (Evaluate = true, choices(checkBox = true), Dialog(group = "Advanced"));
  parameter Modelica.Units.SI.Time maxDelay(min = 0) = 0.1
    "Largest delay that later samples make up for; after a longer one the clock goes on from now"
    annotation (Dialog(group = "Advanced"));

  Modelica.Blocks.Interfaces.RealInput scaling(min = 0) if enableRealTimeScaling
    "Seconds of the clock for one of simulation time: 2 is half as fast, 0 as fast as possible"
    annotation (Placement(transformation(extent = {{-140, -20}, {-100, 20}})));
  Modelica.Blocks.Interfaces.RealOutput calculationTime(unit = "s", displayUnit = "ms")
    "Time from the end of the sample before to this one"
    annotation (Placement(transformation(extent = {{100, 70}, {120, 90}})));
  Modelica.Blocks.Interfaces.RealOutput availableTime(unit = "s", displayUnit = "ms")
    "Time that the calculation may take at most"
    annotation (Placement(transformation(extent = {{100, 20}, {120, 40}})));
  Modelica.Blocks.Interfaces.RealOutput lateness(unit = "s", displayUnit = "ms")
    "By how much the sample came too late"
    annotation (Placement(transformation(extent = {{100, -40}, {120, -20}})));
  Modelica.Blocks.Interfaces.IntegerOutput missed(start = 0, fixed = true)
    "Number of samples that came too late"
    annotation (Placement(transformation(extent = {{100, -90}, {120, -70}})));
protected
  Modelica.Blocks.Interfaces.RealInput actualScaling "Pace that is used";
  Modelica.Blocks.Sources.Constant noScaling(k = 1) if not enableRealTimeScaling
    "Simulation time is the time of the clock";
  parameter EtherCAT.Objects.RealtimeClock realtimeClock = EtherCAT.Objects.RealtimeClock(
    if setPriority then Integer(priority) else 0) "Clock";
  discrete Real results[4](each start = 0, each fixed = true) "Results of the clock";
  Real keepAlive(start = 0, fixed = true)
    "A co-simulation FMU of some tools needs a continuous state";
equation
  connect(scaling, actualScaling);
  connect(noScaling.y, actualScaling);
  der(keepAlive) = 0;
  when sample(0, sampleTime) and enable then
    results = EtherCAT.Functions.synchronize(realtimeClock, time, actualScaling, maxDelay);
    missed = integer(results[4]);
  end when;
  calculationTime = results[1];
  availableTime = results[2];
  lateness = results[3];

  annotation (
    defaultComponentName = "synchronizeRealtime",
    Documentation(info = "<html>
<p>
Holds the simulation back so that it does not run ahead of the clock of the machine (CLOCK_MONOTONIC):
for models without a bus, or with an <a href=\"modelica://EtherCAT.EtherCATMaster\">EtherCATMaster</a>
that does not wait for the bus. A model paced by the bus needs no other pace: leave this block out.
</p>
<p>
This block has a <code>sample()</code> of its own. Beside an EtherCATMaster, give it the same <code>sampleTime</code> as
<code>baseTime</code> of that block: then both have the same instants. With another one, their instants differ by some 1e-14&nbsp;s
after some seconds. Values do not suffer, because this block has none of the bus, but each of them is an event of its own,
and a solver such as <code>cvode</code> may end because it cannot make so short a step.
</p>
<p>
The first sample is the origin. Each later one waits until as much time has passed on the clock as
in the simulation, times <code>scaling</code>. A sample that comes later than that does not wait at
all: <code>lateness</code> says by how much, <code>missed</code> counts. The following samples make up
for a delay of at most <code>maxDelay</code>. After a longer one, such as a pause in the
debugger, they do not make up for it: the clock goes on from there, because a model that runs through minutes
in a second is bad for hardware.
</p>
<p>
Name, parameters and <code>calculationTime</code>, <code>availableTime</code> are those of the block in
the library Modelica_DeviceDrivers, which the paper on the DLR EtherCAT library uses; so a model
changes from one to the other by its prefix (and by the type of <code>priority</code>, which is an
enumeration here). Unlike that block, this one reads the clock at sample instants only, and not in every step
of the solver.
</p>
<p>
<strong>Priority</strong>: High and Realtime need rights (see
<a href=\"modelica://EtherCAT.Types.ProcessPriority\">ProcessPriority</a>). Without them a message is
written and the simulation goes on. This is soft real-time: no deadline is guaranteed, and outputs
of a model that comes too late become safe (see <code>lease</code> of the EtherCATMaster).
</p>
</html>"),
    Icon(graphics = {Text(extent = {{-150, -110}, {150, -150}}, textString = "%priority")}));
end SynchronizeRealtime;
