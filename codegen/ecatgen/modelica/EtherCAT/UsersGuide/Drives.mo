within EtherCAT.UsersGuide;
class Drives "Drives"
  extends Modelica.Icons.Information;

  annotation (Documentation(info = "<html>
<p>
A drive with the device profile CiA&nbsp;402 needs more than its process data: it is led through states by its
control word, has a mode of operation, and its own units. The blocks in
<a href=\"modelica://EtherCAT.Drives\">Drives</a> do that. For each drive of a bus the generated library has a
block that joins one of them with the block of the slave: SI units outside, raw values inside.
</p>
<h4>Before the motor turns</h4>
<ol>
<li>Safe outputs are no emergency stop: have one that needs no software.</li>
<li>Set what the library cannot know: increments of the encoder for one revolution, gear ratio, rated torque
and rated current. The objects 0x608F, 0x6076 and 0x6075 of most drives have them; <code>ecatctl sdo-read</code>
shows them.</li>
<li>Limit the torque, and begin with a speed that harms nobody.</li>
<li>Watch <code>valid</code> and the state of the drive in the first simulation, with <code>enable</code>
false.</li>
</ol>
<h4>What happens when the model ends</h4>
<p>
The control word falls to its safe value within the <code>lease</code> of the EtherCATMaster, and the drive
stops as it is configured to. The daemon can bring a moving drive to rest first: see the configuration of
safe outputs in the documentation of ecatd.
</p>
</html>"));
end Drives;
