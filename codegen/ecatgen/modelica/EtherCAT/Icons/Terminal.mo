within EtherCAT.Icons;
partial block Terminal "Icon of a terminal with several channels"
  annotation (
    Icon(graphics = {
      Rectangle(extent = {{-100, 100}, {100, -100}}, lineColor = {64, 64, 64}, fillColor = {250, 252, 252}, fillPattern = FillPattern.Solid, radius = 6),
      Rectangle(extent = {{-32, 24}, {32, -72}}, lineColor = {64, 64, 64}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid, radius = 4),
      Ellipse(extent = {{-22, 14}, {-4, -4}}, lineColor = {64, 64, 64}, fillColor = {95, 158, 160}, fillPattern = FillPattern.Solid),
      Ellipse(extent = {{4, 14}, {22, -4}}, lineColor = {64, 64, 64}, fillColor = {95, 158, 160}, fillPattern = FillPattern.Solid),
      Ellipse(extent = {{-22, -14}, {-4, -32}}, lineColor = {64, 64, 64}, fillColor = {192, 192, 192}, fillPattern = FillPattern.Solid),
      Ellipse(extent = {{4, -14}, {22, -32}}, lineColor = {64, 64, 64}, fillColor = {192, 192, 192}, fillPattern = FillPattern.Solid),
      Ellipse(extent = {{-22, -42}, {-4, -60}}, lineColor = {64, 64, 64}, fillColor = {192, 192, 192}, fillPattern = FillPattern.Solid),
      Ellipse(extent = {{4, -42}, {22, -60}}, lineColor = {64, 64, 64}, fillColor = {192, 192, 192}, fillPattern = FillPattern.Solid),
      Text(extent = {{-90, 64}, {90, 32}}, textColor = {32, 96, 96}, textString = "%class", textStyle = {TextStyle.Bold}),
      Text(extent = {{20, 92}, {95, 68}}, textColor = {96, 96, 96}, textString = "valid", horizontalAlignment = TextAlignment.Right),
      Text(extent = {{-150, 150}, {150, 110}}, textColor = {0, 0, 255}, textString = "%name")}),
    Documentation(info = "<html>
<p>
A partial block that has the icon of a terminal: a box with the class name, the name of the component
above it, lamps, and the label of the connector <code>valid</code> of
<a href=\"modelica://EtherCAT.Interfaces.PartialSlave\">PartialSlave</a>.
</p>
</html>"));
end Terminal;
