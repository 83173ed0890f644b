within EtherCAT;
block EtherCATMaster "Connection of the model to one EtherCAT bus"
  extends EtherCAT.Icons.Master;

  parameter String bus = "ecat0" "Name of the bus, as given to ecatd";
  parameter Modelica.Units.SI.Period sampleTime[:] = {0.001} "Sample time of each domain"
    annotation (Dialog(group = "Pace"));
  parameter Boolean waitForBus = false
    "= true, if every sample waits for the bus, so that the bus paces the simulation"
    annotation (choices(checkBox = true), Dialog(group = "Pace"));
  parameter Modelica.Units.SI.Time lease(min = 0) = 0.1
    "Time without samples after which outputs fall to their safe values"
    annotation (Dialog(group = "Pace"));
  parameter EtherCAT.Types.BusFailure whenMissing = EtherCAT.Types.BusFailure.Error
    "What to do when the bus is not there at the start"
    annotation (Dialog(group = "Without a bus"));
  parameter EtherCAT.Types.BusFailure whenFailed = EtherCAT.Types.BusFailure.Error
    "What to do when the bus is lost later, or the lease"
    annotation (Dialog(group = "Without a bus"));
  parameter Modelica.Units.SI.Time patience(min = 0) = 0
    "Longest time to wait for the bus, 0: for ever"
    annotation (Dialog(group = "Without a bus",
      enable = whenMissing == EtherCAT.Types.BusFailure.Wait or whenFailed == EtherCAT.Types.BusFailure.Wait));
  parameter Boolean readOnly = false
    "= true, if the model only watches: it writes nothing, so it may run beside another program"
    annotation (choices(checkBox = true), Dialog(group = "Outputs"));
  parameter Boolean requireOperational = false
    "= true, if the simulation ends when a slave of the model is not in OP"
    annotation (choices(checkBox = true), Dialog(group = "Without a bus"));
  final parameter Modelica.Units.SI.Period baseTime = EtherCAT.Functions.baseTime(sampleTime)
    "Time between two samples of the bus, which all sample times are multiples of"
    annotation (Evaluate = true);
  parameter EtherCAT.Objects.Master master = EtherCAT.Objects.Master(
    bus, waitForBus, baseTime, size(sampleTime, 1), lease, Integer(whenMissing),
    Integer(whenFailed), patience, readOnly, requireOperational, getInstanceName()) "Connection"
    annotation (Dialog(enable = false));

  output Boolean sampled[size(sampleTime, 1)] "True at the sample instants of each domain";
  output Integer cycle(start = 0, fixed = true) "Bus cycle of the last sample, modulo 2^31";
  output Boolean connected(start = false, fixed = true)
    "= true, if the sample is of a bus that delivers";
  output EtherCAT.Types.BusState state(start = EtherCAT.Types.BusState.Missing, fixed = true)
    "State of the bus";
  output Modelica.Units.SI.Time age(start = 1e9, fixed = true)
    "Time from the exchange with the slaves to the sample, 1e9 s before the first one";
  output Integer missed(start = 0, fixed = true)
    "Bus cycles in addition to those that the model waited for: sum since the start";
  output Integer workingCounter(start = 0, fixed = true)
    "Sum of the working counters of all domains of the bus";
  output Integer workingCounterExpected(start = 0, fixed = true)
    "Working counter when all slaves take part";
protected
  Boolean tick "True at the samples of the bus";
  discrete Real count(start = -1, fixed = true) "Number of such samples, 0 at the first";
  Real keepAlive(start = 0, fixed = true)
    "A co-simulation FMU of some tools needs a continuous state";
equation
  assert(lease >= 0, "EtherCAT: the lease of the EtherCATMaster must not be negative; change lease");
  der(keepAlive) = 0;
  // One sample() for all domains: tools add up the instants of each one, and two sums drift apart by rounding.
  tick = sample(0, baseTime);
  for d in 1:size(sampleTime, 1) loop
    sampled[d] = tick and EtherCAT.Functions.isSampled(count, sampleTime[d]/baseTime);
  end for;
  when tick then
    count = pre(count) + 1;
    cycle = EtherCAT.Functions.waitCycle(master, time);
    (connected, age, missed, state, workingCounter, workingCounterExpected) =
      EtherCAT.Functions.masterState(master, time, cycle);
  end when;

  annotation (
    defaultComponentName = "etherCATMaster",
    defaultComponentPrefixes = "inner",
    missingInnerMessage = "The blocks of slaves need a component \"inner EtherCAT.EtherCATMaster etherCATMaster\" in the model.",
    Documentation(info = "<html>
<p>
Every model that uses a bus has one component of this block, called <code>etherCATMaster</code> and
declared <code>inner</code>. All blocks of slaves find it without a connection.
</p>
<h4>Samples</h4>
<p>
<code>sampleTime</code> has one element for each domain of the model. The block of a slave chooses one
by its parameter <code>domainID</code> (1 is the first). All reads at the same simulation time see the
same bus cycle, even in different domains.
</p>
<p>
All domains are sampled by one clock. Its period <code>baseTime</code> is the longest time that all sample times are
whole multiples of (to 1e-9): with 1&nbsp;ms and 4&nbsp;ms it is 1&nbsp;ms, with 2&nbsp;ms and 3&nbsp;ms it is 1&nbsp;ms, too.
The translation fails if it would be shorter than a tenth of the shortest sample time. For this check,
<code>sampleTime</code> is fixed when the model is translated.
</p>
<p>
With <code>waitForBus = true</code> each sample of this clock waits until as many bus cycles have passed as
<code>baseTime</code> has; it must be a multiple of the bus cycle. With
<code>waitForBus = false</code> the model runs as fast as the tool runs it, and a sample takes the values that
the bus has at that moment.
</p>
<p>
With <code>readOnly = true</code> the model owns no outputs and writes nothing, neither process data nor
objects. Its blocks read the bus while another program writes the outputs. Values for outputs are dropped, and
SDO blocks that write fail with a text that says so.
</p>
<p>
A simulation that is stopped, paused or killed takes no more samples. After the time <code>lease</code>
(at most 0.5&nbsp;s, the daemon cuts longer ones; 0 takes its default) the daemon sets the outputs that the model has written
to their safe values. Waiting for the bus does not count as a pause, so that with <code>waitForBus</code> sample
times may be longer.
</p>
<p>
Each sample of the clock is an event for the solver. Equations of your own that belong to a domain use
<code>when etherCATMaster.sampled[1] then</code>, with the number of the domain. Do not write a <code>sample()</code> of
your own for the same instants: after some seconds it is no longer true at the same time, but some 1e-14&nbsp;s
before or after. Then it sees the values of another bus cycle, and some solvers (such as <code>cvode</code>) end or hang
because they cannot make so short a step.
</p>
<h4>Without a bus</h4>
<p>
<code>whenMissing</code> says what happens when no daemon serves the bus at the start,
<code>whenFailed</code> what happens when it ends or its cycle stands still later, or when the model has
lost its outputs, because it did not sample in time or the daemon has started again:
</p>
<table border=\"1\" cellspacing=\"0\" cellpadding=\"2\">
<tr><th>value</th><th>no bus</th><th>outputs lost</th></tr>
<tr><td><code>Error</code></td><td>the simulation ends with an error</td><td>the simulation ends with an error</td></tr>
<tr><td><code>Wait</code></td><td>the simulation waits, at most for the time <code>patience</code>, and then goes on</td><td>they are claimed again</td></tr>
<tr><td><code>Continue</code></td><td>the simulation goes on: <code>valid</code> of all slaves is false, values are the last ones (at first those of zeros on the bus), writes are dropped; when the bus is there, it is used from the next sample on</td><td>they are claimed again</td></tr>
</table>
<p>
With <code>Continue</code> and <code>waitForBus</code> the clock of the machine paces the model while there
is no bus. When the bus comes back, the outputs of the model act at once. If the model must start softly then,
use <code>valid</code> of its slaves.
</p>
<p>
Whenever the model connects to a bus, it checks that the bus has the slaves and entries of its blocks. A wrong
bus, outputs that another program owns, and a value that does not fit its entry end the simulation in all
cases.
</p>
<h4>Slaves that leave OP</h4>
<p>
When a slave of the model leaves OP, or does not answer any more, the log of the simulation says so, with the
block, the state and the AL status code, and it says when the slave is back. The model goes on, and
<code>valid</code> of the block is false. With <code>requireOperational = true</code> the simulation ends with that
sentence instead. A single lost frame does not end the simulation.
</p>
<h4>Diagnostics</h4>
<p>
The outputs are those of the last sample of any domain. <code>state</code> goes from
<code>Missing</code> to <code>Operational</code>, see
<a href=\"modelica://EtherCAT.Types.BusState\">BusState</a>; <code>connected</code> is true from
<code>Incomplete</code> on. <code>age</code> goes on growing while there is no bus, and is
1e9&nbsp;s before the first exchange. <code>missed</code>
counts only with <code>waitForBus</code>: all bus cycles in addition to those that the samples waited for,
because the model or the machine was too slow. In a run with <i>n</i> samples of <i>k</i> bus cycles each the bus
has made <i>n&nbsp;k</i>&nbsp;+&nbsp;<code>missed</code> cycles.
<code>workingCounter</code> is less than <code>workingCounterExpected</code> while slaves do not take part
in the exchange.
</p>
</html>"));
end EtherCATMaster;
