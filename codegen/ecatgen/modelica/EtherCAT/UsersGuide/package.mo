within EtherCAT;
package UsersGuide "User's Guide"
  extends Modelica.Icons.Information;

  annotation (
    DocumentationClass = true,
    preferredView = "info",
    Documentation(info = "<html>
<p>
The library connects models to EtherCAT hardware through the daemon <code>ecatd</code>. The daemon is the
master of the bus; a model is one of its clients and may start, stop and fail while the bus stays in
operation.
</p>
<table border=\"1\" cellspacing=\"0\" cellpadding=\"2\">
<tr><th>page</th><th>read it</th></tr>
<tr><td><a href=\"modelica://EtherCAT.UsersGuide.GettingStarted\">Getting started</a></td><td>first</td></tr>
<tr><td><a href=\"modelica://EtherCAT.UsersGuide.Concept\">Concept</a></td>
<td>to know who does what, and when a value leaves or arrives</td></tr>
<tr><td><a href=\"modelica://EtherCAT.UsersGuide.OwnBlocks\">Blocks of your own</a></td>
<td>when a generated block is not what you need</td></tr>
<tr><td><a href=\"modelica://EtherCAT.UsersGuide.Drives\">Drives</a></td>
<td>before a motor turns</td></tr>
<tr><td><a href=\"modelica://EtherCAT.UsersGuide.SDO\">Objects of slaves (SDO)</a></td>
<td>to read or set what is not in the process data</td></tr>
<tr><td><a href=\"modelica://EtherCAT.UsersGuide.FMU\">Export as FMU</a></td>
<td>when the model shall run without its tool</td></tr>
<tr><td><a href=\"modelica://EtherCAT.UsersGuide.Errors\">Errors</a></td>
<td>when a simulation ends with a message</td></tr>
</table>
</html>"));
end UsersGuide;
