within EtherCAT.UsersGuide;
class Concept "Concept: parts, samples, pace and owners of outputs"
  extends Modelica.Icons.Information;

  annotation (Documentation(info = "<html>
<h4>Parts</h4>
<p>
The daemon <code>ecatd</code> exchanges process data with all slaves in each cycle of the bus, typically every
1&nbsp;ms, and keeps their latest values in shared memory. A model reads and writes there. So a model never
delays the bus, and many programs can read at the same time.
</p>
<p>
The <a href=\"modelica://EtherCAT.EtherCATMaster\">EtherCATMaster</a> is the connection of a model to one bus.
A block of a slave has a connector for each entry of its process data, and the connector <code>valid</code>: the
value is fresh, and the slave is in OP.
</p>
<h4>A sample</h4>
<p>
At each sample instant of a domain, in this order:
</p>
<ol>
<li>the master waits for the bus, if <code>waitForBus</code>;</li>
<li>one image of all inputs is taken; all blocks of this instant read from it, also those of other
domains, in whatever order the tool evaluates them;</li>
<li>the model computes;</li>
<li>the blocks write, and the outputs of all slaves of the domain are handed over together. They leave with the next cycle of
the bus.</li>
</ol>
<p>
A tool may evaluate an instant more than once; the values that were written last count.
</p>
<h4>Pace</h4>
<table border=\"1\" cellspacing=\"0\" cellpadding=\"2\">
<tr><th>the model is paced by</th><th>how</th></tr>
<tr><td>the bus, and with distributed clocks by the drives</td><td><code>waitForBus = true</code></td></tr>
<tr><td>the clock of the machine</td>
<td><a href=\"modelica://EtherCAT.SynchronizeRealtime\">SynchronizeRealtime</a></td></tr>
<tr><td>the tool, or the program that runs the FMU</td><td><code>waitForBus = false</code></td></tr>
</table>
<h4>Values</h4>
<p>
Generated blocks with a device profile have physical values in SI units. Others have the values of the process
data: Boolean for one bit, Integer for what fits into 32 bits with a sign, Real for the rest (exact up to
2^53) and for floating-point entries. The blocks in
<a href=\"modelica://EtherCAT.Conversions\">Conversions</a> convert.
</p>
<h4>Owner of outputs</h4>
<p>
The first write of a block makes the model the owner of all outputs of that slave. A second program
that wants to write them fails with the name of the owner. Outputs that nobody has written keep their
safe values. When the simulation ends in any way, or takes no samples for the time <code>lease</code>, its
outputs become safe within that time, and the bus goes on.
</p>
<h4>Two domains</h4>
<p>
<code>sampleTime</code> of the master has one element for each domain of the model, and a block
chooses one by <code>domainID</code>. <a href=\"modelica://EtherCAT.Examples.TwoDomains\">TwoDomains</a> shows
slaves at 1000&nbsp;Hz and at 250&nbsp;Hz. One clock samples all domains, and each domain counts its samples. So they
stay together however long the model runs. Its period, <code>baseTime</code> of the master, is the longest time that all
sample times are whole multiples of.
</p>
<p>
Your own sampled equations use <code>when etherCATMaster.sampled[1] then</code>. A <code>sample()</code> of your own with the
same period does not stay at the same instants: the rounding of the two sums differs.
</p>
</html>"));
end Concept;
