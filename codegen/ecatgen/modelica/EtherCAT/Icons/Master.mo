within EtherCAT.Icons;
partial block Master "Icon of a bus master"
  annotation (
    Icon(graphics = {
    Rectangle(extent = {{-100, 100}, {100, -100}}, lineColor = {64, 64, 64}, fillColor = {240, 248, 248}, fillPattern = FillPattern.Solid, radius = 10),
    Rectangle(extent = {{-40, 70}, {40, 20}}, lineColor = {64, 64, 64}, fillColor = {95, 158, 160}, fillPattern = FillPattern.Solid, radius = 4),
    Line(points = {{0, 20}, {0, -10}}, color = {64, 64, 64}, thickness = 1),
    Line(points = {{-80, -10}, {80, -10}}, color = {64, 64, 64}, thickness = 1),
    Line(points = {{-60, -10}, {-60, -30}}, color = {64, 64, 64}, thickness = 1),
    Line(points = {{0, -10}, {0, -30}}, color = {64, 64, 64}, thickness = 1),
    Line(points = {{60, -10}, {60, -30}}, color = {64, 64, 64}, thickness = 1),
    Rectangle(extent = {{-75, -30}, {-45, -55}}, lineColor = {64, 64, 64}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid),
    Rectangle(extent = {{-15, -30}, {15, -55}}, lineColor = {64, 64, 64}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid),
    Rectangle(extent = {{45, -30}, {75, -55}}, lineColor = {64, 64, 64}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid),
    Text(extent = {{-90, -65}, {90, -95}}, textString = "%bus"),
    Text(extent = {{-150, 150}, {150, 110}}, textColor = {0, 0, 255}, textString = "%name")}),
    Documentation(info = "<html>
<p>
A partial block that has the icon of a bus master: a box over a line with slaves, and the name of the bus.
</p>
</html>"));
end Master;
