within EtherCAT;
package UsersGuide "User's Guide"
  extends Modelica.Icons.Information;

  class GettingStarted "Getting started"
    extends Modelica.Icons.Information;
    annotation (Documentation(info = "<html>
<ol>
<li>Start the daemon: <code>systemctl start ecatd</code>, or <code>ecatd --simulate troll</code> for a
simulated bus without hardware.</li>
<li>Generate the library of the bus: <code>ecatctl generate TrollPlant DIR</code>.</li>
<li>Load <code>DIR/EtherCAT/package.mo</code>, then <code>DIR/TrollPlant/package.mo</code>.</li>
<li>Simulate <code>TrollPlant.Examples.AllSlaves</code>.</li>
<li>For a model of your own, drag in one
<a href=\"modelica://EtherCAT.EtherCATMaster\">EtherCATMaster</a> and the blocks of the slaves that
you need, and connect them like any other block.</li>
</ol>
</html>"));
  end GettingStarted;

  class Sampling "Samples, time and outputs"
    extends Modelica.Icons.Information;
    annotation (Documentation(info = "<html>
<p>
At each sample instant of a domain, in this order: the master waits for the bus (if
<code>waitForBus</code>), one image of all inputs is taken, all blocks of the domain read from it, the
model computes, the blocks write, and the outputs of each slave are handed over together. They leave
with the next bus cycle.
</p>
<p>
The connectors carry the raw values of the process data: Boolean for one bit, Integer for what fits into
32 bits with a sign, Real for the rest (exact up to 2^53) and for floating-point entries.
</p>
<p>
The first write makes the model the owner of all outputs of that slave. A second model that wants to
write them fails with the name of the owner. Outputs of a slave to whose block nothing was written keep
their safe values. When the simulation ends, however it does, all its outputs become safe.
</p>
</html>"));
  end Sampling;

  class Errors "Error messages"
    extends Modelica.Icons.Information;
    annotation (Documentation(info = "<html>
<table border=\"1\" cellspacing=\"0\" cellpadding=\"2\">
<tr><th>message</th><th>what to do</th></tr>
<tr><td>no ecatd serves bus ...</td><td>Start the daemon; check the parameter <code>bus</code> of the
EtherCATMaster.</td></tr>
<tr><td>no right to read bus ...</td><td>Become a member of the group <code>ecat</code>.</td></tr>
<tr><td>slave ... is ..., but this library was generated for ...</td><td>The bus has changed. Generate
the library again with the command in the message, or put the right slave back.</td></tr>
<tr><td>the outputs of slave ... belong to ...</td><td>Another program writes them. End it
first.</td></tr>
<tr><td>this client did not sample in time ...</td><td>The simulation was slower than the
<code>lease</code> of the EtherCATMaster, or paused. The outputs are safe. Start again; make the model
faster, or the lease longer.</td></tr>
<tr><td>... is out of range for ...</td><td>Limit the signal before it reaches the block.</td></tr>
<tr><td>the sample time of ... is no multiple of the bus cycle</td><td>Change <code>sampleTime</code>,
or do not wait for the bus.</td></tr>
<tr><td>the daemon of bus ... has ended</td><td>Start it again, then the simulation.</td></tr>
</table>
</html>"));
  end Errors;

  class Contact "Contact"
    extends Modelica.Icons.Contact;
    annotation (Documentation(info = "<html>
<p>
The library belongs to the project ecatd and has its licence (MIT). It follows the library that is
described in: <em>The DLR EtherCAT Library: A template based code-generation scheme for accessing
real-time hardware from Modelica</em>.
</p>
</html>"));
  end Contact;

  class ReleaseNotes "Release notes"
    extends Modelica.Icons.ReleaseNotes;
    annotation (Documentation(info = "<html>
<h4>Version 0.1.0</h4>
<p>
First version.
</p>
</html>"));
  end ReleaseNotes;

  annotation (
    DocumentationClass = true,
    Documentation(info = "<html>
<p>
The library connects models to EtherCAT hardware through the daemon <code>ecatd</code>.
</p>
</html>"));
end UsersGuide;
