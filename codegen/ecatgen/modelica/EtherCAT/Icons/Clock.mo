within EtherCAT.Icons;
partial block Clock "Icon of a block that follows the clock"
  annotation (
    Icon(graphics = {
      Rectangle(extent = {{-100, 100}, {100, -100}}, lineColor = {64, 64, 64}, fillColor = {240, 248, 248}, fillPattern = FillPattern.Solid, radius = 10),
      Ellipse(extent = {{-70, 70}, {70, -70}}, lineColor = {64, 64, 64}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid, lineThickness = 1),
      Line(points = {{0, 70}, {0, 58}}, color = {64, 64, 64}),
      Line(points = {{70, 0}, {58, 0}}, color = {64, 64, 64}),
      Line(points = {{0, -70}, {0, -58}}, color = {64, 64, 64}),
      Line(points = {{-70, 0}, {-58, 0}}, color = {64, 64, 64}),
      Line(points = {{0, 50}, {0, 0}, {34, -20}}, color = {95, 158, 160}, thickness = 1),
      Ellipse(extent = {{-5, 5}, {5, -5}}, lineColor = {64, 64, 64}, fillColor = {64, 64, 64}, fillPattern = FillPattern.Solid),
      Text(extent = {{-150, 150}, {150, 110}}, textColor = {0, 0, 255}, textString = "%name")}),
    Documentation(info = "<html>
<p>
A partial block that has the icon of a clock.
</p>
</html>"));
end Clock;
