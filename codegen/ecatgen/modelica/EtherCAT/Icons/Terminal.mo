within EtherCAT.Icons;
partial block Terminal "Icon of a terminal with several channels"
  annotation (
    Icon(graphics = {
      Rectangle(extent = {{-100, 100}, {100, -100}}, lineColor = {64, 64, 64}, fillColor = {250, 252, 252}, fillPattern = FillPattern.Solid, radius = 6),
      Rectangle(extent = {{-30, 40}, {30, -70}}, lineColor = {64, 64, 64}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid, radius = 4),
      Ellipse(extent = {{-20, 30}, {-4, 14}}, lineColor = {64, 64, 64}, fillColor = {95, 158, 160}, fillPattern = FillPattern.Solid),
      Ellipse(extent = {{4, 30}, {20, 14}}, lineColor = {64, 64, 64}, fillColor = {95, 158, 160}, fillPattern = FillPattern.Solid),
      Ellipse(extent = {{-20, 4}, {-4, -12}}, lineColor = {64, 64, 64}, fillColor = {192, 192, 192}, fillPattern = FillPattern.Solid),
      Ellipse(extent = {{4, 4}, {20, -12}}, lineColor = {64, 64, 64}, fillColor = {192, 192, 192}, fillPattern = FillPattern.Solid),
      Ellipse(extent = {{-20, -22}, {-4, -38}}, lineColor = {64, 64, 64}, fillColor = {192, 192, 192}, fillPattern = FillPattern.Solid),
      Ellipse(extent = {{4, -22}, {20, -38}}, lineColor = {64, 64, 64}, fillColor = {192, 192, 192}, fillPattern = FillPattern.Solid),
      Text(extent = {{-90, 90}, {90, 55}}, textColor = {32, 96, 96}, textString = "%class", textStyle = {TextStyle.Bold}),
      Text(extent = {{-150, 150}, {150, 110}}, textColor = {0, 0, 255}, textString = "%name")}),
    Documentation(info = "<html>
<p>
A partial block that has the icon of a terminal: a box with the class name, the name of the component
above it, and lamps.
</p>
</html>"));
end Terminal;
