within EtherCAT;
block SDOReadString "Read an object of a slave as a String"
  extends EtherCAT.Interfaces.PartialSDOString;

  output String y(start = "", fixed = true)
    "Value of the object at the last successful request";
equation
  when etherCATMaster.sampled[1] then
    state = EtherCAT.Functions.sdoRead(sdo, time, etherCATMaster.cycle, triggered);
    y = EtherCAT.Functions.sdoString(sdo, state);
  end when;

  annotation (
    defaultComponentName = "sdoReadString",
    Documentation(info = "<html>
<p>
Uploads a text of the slave at <code>position</code> through its mailbox, such as its name 0x1008. It
arrives at <code>y</code> some bus cycles after the request, when <code>done</code> becomes true and
<code>count</code> advances; until then <code>y</code> is empty. Objects of more than 512 bytes cannot
be read.
</p>
<table border=\"1\" cellspacing=\"0\" cellpadding=\"2\">
<tr><th><code>dataType</code></th><th>text</th></tr>
<tr><td>VISIBLE_STRING</td><td>up to the first zero; bytes beyond ASCII are taken as UTF-8 if all of them
are, else as Latin-1; control characters become question marks</td></tr>
<tr><td>OCTET_STRING</td><td>without the zeros at its end; bytes that are not printable ASCII, and the
backslash, as <code>\\xNN</code></td></tr>
<tr><td>UNICODE_STRING</td><td>UTF-16, up to the first zero</td></tr>
</table>
<p>
<a href=\"modelica://EtherCAT.Interfaces.PartialSDO\">PartialSDO</a> explains when the object is requested, and
what happens to a request that fails.
</p>
</html>"),
    Icon(graphics = {
      Text(extent = {{-80, -10}, {28, -34}}, textColor = {64, 64, 64}, textString = "read String")}));
end SDOReadString;
