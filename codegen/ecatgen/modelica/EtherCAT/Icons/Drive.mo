within EtherCAT.Icons;
partial block Drive "Icon of a drive"
  annotation (
    Icon(coordinateSystem(preserveAspectRatio = true, extent = {{-100, -100}, {100, 100}}, initialScale = 0.2), graphics = {
      Rectangle(extent = {{-100, 100}, {100, -100}}, lineColor = {64, 64, 64}, fillColor = {240, 248, 248}, fillPattern = FillPattern.Solid, radius = 10),
      Rectangle(extent = {{-40, 26}, {24, -26}}, lineColor = {64, 64, 64}, fillColor = {95, 158, 160}, fillPattern = FillPattern.HorizontalCylinder),
      Rectangle(extent = {{24, 8}, {44, -8}}, lineColor = {64, 64, 64}, fillColor = {192, 192, 192}, fillPattern = FillPattern.HorizontalCylinder),
      Polygon(points = {{-40, -26}, {-30, -26}, {-22, -40}, {6, -40}, {14, -26}, {24, -26}, {24, -32}, {18, -32}, {10, -46}, {-26, -46}, {-34, -32}, {-40, -32}, {-40, -26}}, lineColor = {64, 64, 64}, fillColor = {64, 64, 64}, fillPattern = FillPattern.Solid),
      Text(extent = {{-150, 134}, {150, 108}}, textColor = {0, 0, 255}, textString = "%name")}),
    Documentation(info = "<html>
<p>
A partial block that has the icon of a drive.
</p>
</html>"));
end Drive;
