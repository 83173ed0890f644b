within EtherCAT;
package CAN "CAN behind a terminal: messages, signals, and the state of the channel"
  extends Modelica.Icons.Package;

  annotation (
    Icon(graphics = {
      Line(points = {{-70, 20}, {70, 20}}, color = {64, 64, 64}, thickness = 1),
      Line(points = {{-70, 4}, {70, 4}}, color = {64, 64, 64}, thickness = 1),
      Rectangle(extent = {{-50, -20}, {-14, -50}}, lineColor = {64, 64, 64}, fillColor = {95, 158, 160}, fillPattern = FillPattern.Solid),
      Rectangle(extent = {{14, -20}, {50, -50}}, lineColor = {64, 64, 64}, fillColor = {95, 158, 160}, fillPattern = FillPattern.Solid),
      Line(points = {{-36, 4}, {-36, -20}}, color = {64, 64, 64}),
      Line(points = {{-28, 20}, {-28, -20}}, color = {64, 64, 64}),
      Line(points = {{28, 4}, {28, -20}}, color = {64, 64, 64}),
      Line(points = {{36, 20}, {36, -20}}, color = {64, 64, 64})}),
    Documentation(info = "<html>
<p>
Blocks for single messages and signals. Read <a href=\"modelica://EtherCAT.UsersGuide.CAN\">the page on CAN</a> first. If
there is a DBC or EDS file, <code>ecatctl generate --can</code> writes a block with all of its signals instead.
</p>
</html>"));
end CAN;
