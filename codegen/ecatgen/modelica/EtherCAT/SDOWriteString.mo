within EtherCAT;
block SDOWriteString "Write a String to an object of a slave"
  extends EtherCAT.Interfaces.PartialSDOString;

  parameter String u = "" "Value to write" annotation (Dialog(group = "Object"));
equation
  when etherCATMaster.sampled[1] then
    state = EtherCAT.Functions.sdoWriteString(
      sdo, time, etherCATMaster.cycle, triggered, u);
  end when;

  annotation (
    defaultComponentName = "sdoWriteString",
    Documentation(info = "<html>
<p>
Downloads the text <code>u</code> to an object of the slave at <code>position</code> through its mailbox. <code>done</code> becomes true when the slave has accepted
it. A text that the data type cannot hold, or of more than 512 bytes, ends the simulation.
</p>
<table border=\"1\" cellspacing=\"0\" cellpadding=\"2\">
<tr><th><code>dataType</code></th><th>bytes</th></tr>
<tr><td>VISIBLE_STRING</td><td>those of the text; the standard has ASCII only</td></tr>
<tr><td>OCTET_STRING</td><td>those of the text, with <code>\\xNN</code> for any byte, and so
<code>\\x5C</code> for the backslash</td></tr>
<tr><td>UNICODE_STRING</td><td>UTF-16</td></tr>
</table>
<p>
An empty text is written as one zero. A text that changes during the simulation is written by a block of
your own with <a href=\"modelica://EtherCAT.Functions.sdoWriteString\">sdoWriteString</a>: here it is a
parameter because tools describe String inputs of an FMU as continuous, which FMI does not allow.
</p>
<p>
<a href=\"modelica://EtherCAT.Interfaces.PartialSDO\">PartialSDO</a> explains when the object is requested, and
what happens to a request that fails.
</p>
</html>"),
    Icon(graphics = {
      Text(extent = {{-80, -10}, {28, -34}}, textColor = {64, 64, 64}, textString = "write String")}));
end SDOWriteString;
