within EtherCAT.UsersGuide;
class OwnBlocks "Blocks of your own"
  extends Modelica.Icons.Information;

  annotation (Documentation(info = "<html>
<p>
Generated blocks are made of external objects that you can use as well: to give a slave other connectors,
to compute where its values are, or to write a library for a family of slaves. Read
<a href=\"modelica://EtherCAT.Examples.Utilities.EL1018\">EL1018</a> (reads) and
<a href=\"modelica://EtherCAT.Examples.Utilities.EL2008\">EL2008</a> (writes): they are short.
</p>
<table border=\"1\" cellspacing=\"0\" cellpadding=\"2\">
<tr><th>object</th><th>is</th><th>made of</th></tr>
<tr><td><a href=\"modelica://EtherCAT.Objects.Master\">Master</a></td><td>the connection to a bus</td>
<td>the EtherCATMaster has it</td></tr>
<tr><td><a href=\"modelica://EtherCAT.Objects.Domain\">Domain</a></td><td>what is sampled together</td>
<td>PartialSlave has it</td></tr>
<tr><td><a href=\"modelica://EtherCAT.Objects.SlaveConfiguration\">SlaveConfiguration</a></td>
<td>the slave that is expected at a position</td><td>PartialSlave has it</td></tr>
<tr><td><a href=\"modelica://EtherCAT.Objects.PDO\">PDO</a></td><td>one entry of its process data</td>
<td>your block has one for each entry</td></tr>
</table>
<ol>
<li>Extend <a href=\"modelica://EtherCAT.Interfaces.PartialSlave\">PartialSlave</a> and set
<code>slaveData</code>: position, vendor ID and product code as <code>ecatctl slaves</code> shows them,
revision number 0 for any. Modelica has no hexadecimal numbers: 0x03FA3052 is 66728018.</li>
<li>Declare a <code>parameter EtherCAT.Objects.PDO</code> for each entry: index, subindex, direction, data type
and bits as <code>ecatctl pdos</code> shows them; the data type as a number, such as
<code>Integer(EtherCAT.Types.DataType.INTEGER32)</code>. With a <code>scale</code>, an <code>offset</code> or a
<code>unit</code> its values are physical. They are computed from raw values, whatever unit and scale the bus has: only a
block with a <code>fingerprint</code> is compared with the bus, and a block of yours has none.</li>
<li>Read in one <code>when sampled</code>, with <code>etherCATMaster.cycle</code>
as the last argument, so that reads come after the sample was taken.</li>
<li>Write and commit in a second one, each write with the result of the one before: this makes the order of the
calls. In one when-equation with the reads the outputs would depend on the inputs, and a controller between
them would close a loop.</li>
</ol>
<p>
The first input of an EL3008 as a voltage, for instance:
</p>
<pre>
block Voltage \"First channel of the EL3008 at position 4\"
  extends EtherCAT.Icons.Terminal;
  extends EtherCAT.Interfaces.PartialSlave(
    slaveData(position = 4, vendorID = 2, productCode = 197144658),
    hwName = \"EL3008\");
  EtherCAT.Interfaces.VoltageOutput v(start = 0, fixed = true) \"Voltage of channel 1\"
    annotation (Placement(transformation(extent = {{100, -10}, {120, 10}})));
protected
  parameter EtherCAT.Objects.PDO channel1 = EtherCAT.Objects.PDO(
    slaveConfiguration, 24576, 17, false, Integer(EtherCAT.Types.DataType.INTEGER16), 16,
    10 / 32767) \"0x6000:11, 32767 is 10 V\";
equation
  when sampled then
    v = EtherCAT.Functions.readReal(channel1, time, etherCATMaster.cycle);
  end when;
end Voltage;
</pre>
<p>
Give the block a <code>generateCommand</code> if there is one; error messages show it. Arrays of external
objects do not work in all tools: use one component for each object, or an array of blocks with one object each.
</p>
</html>"));
end OwnBlocks;
