within EtherCAT.Icons;
partial block CAN "Icon of a part of the CAN bus behind a terminal"
  annotation (
    Icon(graphics = {
    Rectangle(extent = {{-100, 100}, {100, -100}}, lineColor = {64, 64, 64}, fillColor = {245, 248, 255}, fillPattern = FillPattern.Solid, radius = 10),
    Line(points = {{-60, 16}, {60, 16}}, color = {64, 64, 64}, thickness = 1),
    Line(points = {{-60, 4}, {60, 4}}, color = {64, 64, 64}, thickness = 1),
    Rectangle(extent = {{-62, 20}, {-56, 0}}, lineColor = {64, 64, 64}, fillColor = {95, 158, 160}, fillPattern = FillPattern.Solid),
    Rectangle(extent = {{56, 20}, {62, 0}}, lineColor = {64, 64, 64}, fillColor = {95, 158, 160}, fillPattern = FillPattern.Solid),
    Line(points = {{-20, 4}, {-20, -20}}, color = {64, 64, 64}),
    Line(points = {{-12, 16}, {-12, -20}}, color = {64, 64, 64}),
    Rectangle(extent = {{-34, -20}, {2, -44}}, lineColor = {64, 64, 64}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid),
    Text(extent = {{-150, 150}, {150, 110}}, textColor = {0, 0, 255}, textString = "%name")}),
    Documentation(info = "<html>
<p>
A partial block that has the icon of a node on a CAN bus, with its two wires and their terminations.
</p>
</html>"));
end CAN;
