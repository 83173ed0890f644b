within EtherCAT;
block EtherCATMaster "Connection of the model to one EtherCAT bus"
  extends EtherCAT.Icons.Master;

  parameter String bus = "ecat0" "Name of the bus, as given to ecatd";
  parameter Modelica.Units.SI.Period sampleTime[:] = {0.001} "Sample time of each domain";
  parameter Boolean waitForBus = false
    "= true, if every sample of domain 1 waits for the bus, which so paces the simulation"
    annotation (choices(checkBox = true));
  parameter Modelica.Units.SI.Time lease = 0.1
    "Time without samples after which outputs fall to their safe values";
  parameter EtherCAT.Objects.Master master = EtherCAT.Objects.Master(
    bus, waitForBus, sampleTime[1], size(sampleTime, 1), lease) "Connection"
    annotation (Dialog(enable = false));

  output Boolean sampled[size(sampleTime, 1)] "True at the sample instants of each domain";
  output Integer cycle(start = 0, fixed = true) "Bus cycle of the last sample, modulo 2^31";
protected
  Real keepAlive(start = 0, fixed = true)
    "A co-simulation FMU of some tools needs a continuous state";
equation
  der(keepAlive) = 0;
  for d in 1:size(sampleTime, 1) loop
    sampled[d] = sample(0, sampleTime[d]);
  end for;
  when sampled[1] then
    cycle = EtherCAT.Functions.waitCycle(master, time);
  end when;

  annotation (
    defaultComponentName = "etherCATMaster",
    defaultComponentPrefixes = "inner",
    missingInnerMessage = "The blocks of slaves need a component \"inner EtherCAT.EtherCATMaster etherCATMaster\" in the model.",
    Documentation(info = "<html>
<p>
Every model that uses a bus has one component of this block, called <code>etherCATMaster</code> and
declared <code>inner</code>. All blocks of slaves find it by themselves.
</p>
<p>
<strong>Domains</strong>: <code>sampleTime</code> has one element for each domain of the model. The
block of a slave chooses one by its parameter <code>domainID</code> (1 is the first). All reads at the
same simulation time see the same bus cycle.
</p>
<p>
<strong>Pace</strong>: with <code>waitForBus = true</code> each sample of domain 1 waits until as many
bus cycles have passed as its sample time has; the sample time must be a multiple of the bus cycle.
With <code>waitForBus = false</code> the model runs as fast as the tool runs it, and a sample takes what
the bus has at that moment.
</p>
<p>
<strong>Lease</strong>: a simulation that is stopped, paused or killed takes no more samples. After
the time <code>lease</code> (at most 0.5&nbsp;s, the daemon cuts longer ones) the daemon sets the outputs
that the model has written to their safe values. A paused simulation ends with an error when it goes on.
Waiting for the bus is no pause, so that with <code>waitForBus</code> sample times may be longer.
</p>
</html>"));
end EtherCATMaster;
