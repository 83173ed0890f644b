within ;
package EtherCAT "Connection of models to EtherCAT hardware through the bus daemon ecatd"
  extends Modelica.Icons.Package;

  annotation (
    version = "0.1.0",
    uses(Modelica(version = "4.0.0")),
    conversion(noneFromVersion = ""),
    preferredView = "info",
    Documentation(info = "<html>
<p>
Blocks that let a model read and write the process data of EtherCAT slaves. The bus itself belongs to
the daemon <code>ecatd</code>: a model may start, stop and fail while the bus stays in operation.
</p>
<p>
This library is the part that is the same for every bus. The blocks of the slaves of a certain bus are
generated: <code>ecatctl generate NAME DIR</code>, or
<a href=\"modelica://EtherCAT.generateConfiguration\">generateConfiguration</a> inside the tool, writes a
library <code>NAME</code> and a copy of this one beside it.
</p>
<table border=\"1\" cellspacing=\"0\" cellpadding=\"2\">
<tr><th>package</th><th>what is in it</th></tr>
<tr><td><a href=\"modelica://EtherCAT.UsersGuide\">UsersGuide</a></td>
<td>begin with <a href=\"modelica://EtherCAT.UsersGuide.GettingStarted\">Getting started</a></td></tr>
<tr><td><a href=\"modelica://EtherCAT.Examples\">Examples</a></td>
<td>models that run on a simulated bus as they are</td></tr>
<tr><td><a href=\"modelica://EtherCAT.EtherCATMaster\">EtherCATMaster</a></td>
<td>the connection of a model to a bus; every model has one</td></tr>
<tr><td><a href=\"modelica://EtherCAT.SynchronizeRealtime\">SynchronizeRealtime</a></td>
<td>the pace of a model that no bus paces</td></tr>
<tr><td><a href=\"modelica://EtherCAT.SDORead\">SDORead</a>, <a href=\"modelica://EtherCAT.SDOWrite\">SDOWrite</a>,
...</td><td>access to objects through the mailbox of a slave</td></tr>
<tr><td><a href=\"modelica://EtherCAT.Drives\">Drives</a></td>
<td>drives with the device profile CiA&nbsp;402</td></tr>
<tr><td><a href=\"modelica://EtherCAT.Conversions\">Conversions</a></td>
<td>between raw and physical values</td></tr>
<tr><td><a href=\"modelica://EtherCAT.Objects\">Objects</a>, <a href=\"modelica://EtherCAT.Functions\">Functions</a>,
<a href=\"modelica://EtherCAT.Interfaces\">Interfaces</a></td><td>what blocks of your own are made of</td></tr>
</table>
</html>"),
    Icon(graphics = {
      Rectangle(extent = {{-70, 30}, {-30, -10}}, lineColor = {64, 64, 64}, fillColor = {95, 158, 160}, fillPattern = FillPattern.Solid),
      Rectangle(extent = {{-20, 30}, {20, -10}}, lineColor = {64, 64, 64}, fillColor = {95, 158, 160}, fillPattern = FillPattern.Solid),
      Rectangle(extent = {{30, 30}, {70, -10}}, lineColor = {64, 64, 64}, fillColor = {95, 158, 160}, fillPattern = FillPattern.Solid),
      Line(points = {{-80, -40}, {80, -40}}, color = {64, 64, 64}, thickness = 1),
      Line(points = {{-50, -10}, {-50, -40}}, color = {64, 64, 64}, thickness = 1),
      Line(points = {{0, -10}, {0, -40}}, color = {64, 64, 64}, thickness = 1),
      Line(points = {{50, -10}, {50, -40}}, color = {64, 64, 64}, thickness = 1)}));
end EtherCAT;
