within EtherCAT.UsersGuide;
class SDO "Objects of slaves (SDO)"
  extends Modelica.Icons.Information;

  annotation (Documentation(info = "<html>
<p>
Many values are not in the process data, but in the object dictionary of a slave: settings, limits, serial
numbers, temperatures. The SDO blocks read and write one object through the mailbox of the slave, while the
exchange of process data goes on. They never delay the simulation: an answer takes some cycles of the bus, or
some seconds if the slave is slow, and the outputs <code>busy</code>, <code>done</code>,
<code>abortCode</code> and <code>abortText</code> show the result of the request.
</p>
<table border=\"1\" cellspacing=\"0\" cellpadding=\"2\">
<tr><th>value</th><th>read</th><th>write</th></tr>
<tr><td>Integer</td><td><a href=\"modelica://EtherCAT.SDORead\">SDORead</a></td>
<td><a href=\"modelica://EtherCAT.SDOWrite\">SDOWrite</a></td></tr>
<tr><td>Real, also integers of 64 bits and scaled ones</td>
<td><a href=\"modelica://EtherCAT.SDOReadReal\">SDOReadReal</a></td>
<td><a href=\"modelica://EtherCAT.SDOWriteReal\">SDOWriteReal</a></td></tr>
<tr><td>String</td><td><a href=\"modelica://EtherCAT.SDOReadString\">SDOReadString</a></td>
<td><a href=\"modelica://EtherCAT.SDOWriteString\">SDOWriteString</a></td></tr>
</table>
<p>
The parameter <code>request</code> says when an object is requested: by a trigger, periodically, or once at the
start. <a href=\"modelica://EtherCAT.Examples.ReadObject\">ReadObject</a> is an example. The manual of a slave
lists its objects; <code>ecatctl sdo-read 0 0x1000</code> reads one of them.
</p>
<p>
A request that fails does not end the simulation; <a href=\"modelica://EtherCAT.Interfaces.PartialSDO\">PartialSDO</a>
explains <code>abortCode</code>. Objects that must be written one after the other, before a drive is
enabled for instance, are a <a href=\"modelica://EtherCAT.Objects.StartupList\">StartupList</a>. For scripts
there are functions that wait for the answer, such as
<a href=\"modelica://EtherCAT.Functions.readObjectInteger\">readObjectInteger</a>.
</p>
<p>
Write to objects that the slave keeps in its flash memory only now and then: it bears a limited number of
writes.
</p>
</html>"));
end SDO;
