within EtherCAT.UsersGuide;
class Drives "Drives"
  extends Modelica.Icons.Information;

  annotation (Documentation(info = "<html>
<p>
A drive with the device profile CiA&nbsp;402 needs more than its process data: its control word leads it through
states, and it has a mode of operation and its own units.
</p>
<table border=\"1\" cellspacing=\"0\" cellpadding=\"2\">
<tr><th>block</th><th>is for</th></tr>
<tr><td><code>Drives</code> in a generated library</td><td>each drive of your bus: SI units outside, state machine and
slave inside</td></tr>
<tr><td><a href=\"modelica://EtherCAT.Drives.Elmo\">Elmo</a></td><td>an Elmo Gold drive without a generated library, as in
Figure&nbsp;7 of the paper; <a href=\"modelica://EtherCAT.Examples.Drive\">Examples.Drive</a> has one</td></tr>
<tr><td><a href=\"modelica://EtherCAT.Drives.CiA402\">CiA402</a></td><td>a drive block of your own: the state machine and the
conversions. Its documentation explains connectors, parameters and states</td></tr>
</table>
<p>
Nothing jumps: until the drive is <code>enabled</code>, and again after a quick stop, a fault or a loss of the bus, its
targets follow the actual values. In position modes the reference then counts from where the drive is, or is
approached with a limited speed; see <a href=\"modelica://EtherCAT.Types.DriveReference\">DriveReference</a>.
</p>
<h4>Before the motor turns</h4>
<ol>
<li>Safe outputs are not an emergency stop: have an emergency stop that needs no software.</li>
<li>Set the data that the library cannot know: increments of the encoder for one revolution, gear ratio, rated
torque and rated current. Most drives have them in the objects 0x608F, 0x6076 and 0x6075, which
<code>ecatctl sdo-read</code> shows. A message in the log of the simulation names each one that differs.</li>
<li>Limit the torque by <code>tau_max</code>. If the process data have no 0x6072 and the mode is not a torque mode,
limit it in the drive. Begin with a speed that cannot do harm.</li>
<li>Hold integrators of controllers in the model until <code>enabled</code> is true.</li>
<li>With <code>enable</code> true from the first sample on, a drive that is switched off and has no fault starts. One that has
a fault waits until <code>enable</code> is switched off and on, which resets the fault, unless <code>useFaultReset</code>
adds a separate input for that.</li>
<li>After a loss, a fault or a quick stop the drive stays off until <code>enable</code> is switched off and on. With
<code>restart = Automatic</code> it starts by itself: see
<a href=\"modelica://EtherCAT.Types.DriveRestart\">DriveRestart</a>.</li>
<li>Watch <code>valid</code> and the state of the drive in the first simulation, with <code>enable</code>
false.</li>
</ol>
<h4>What happens when the model ends</h4>
<p>
The control word falls to its safe value, and the drive stops as it is configured to: at once if the process of the
model has ended, and within the <code>lease</code> of the EtherCATMaster if it hangs. The daemon can bring a moving drive to rest first: see the configuration of
safe outputs in the documentation of ecatd.
</p>
</html>"));
end Drives;
