within EtherCAT.UsersGuide;
class FMU "Export as FMU"
  extends Modelica.Icons.Information;

  annotation (Documentation(info = "<html>
<p>
A model with EtherCAT blocks is exported like any other model. The C client is linked statically. So the FMU
needs the daemon on the machine where it runs, but no library of ecatd.
</p>
<ul>
<li>Choose co-simulation, and a communication step that is not longer than the sample time: within a step some
tools leave out calls whose results nothing uses.</li>
<li><code>bus</code>, <code>waitForBus</code> and <code>lease</code> of the master can be set before the
initialization; <code>sampleTime</code> and <code>domainID</code> are fixed by the export.</li>
<li>With <code>waitForBus</code> the FMU paces the program that runs it. Switch the real-time option of that
program off.</li>
<li>Co-simulation FMUs of OpenModelica 1.25 report a step as successful even if it has ended with an error: watch
the log of an FMU that runs for long.</li>
</ul>
<p>
Without any model, <code>ecatctl generate TrollPlant DIR --fmu</code> makes an FMU of the bus itself: a variable
for each signal, for Simulink, Dymola, FMPy and other importers.
</p>
</html>"));
end FMU;
