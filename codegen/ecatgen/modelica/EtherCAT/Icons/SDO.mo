within EtherCAT.Icons;
partial block SDO "Icon of a request to the mailbox of a slave"
  annotation (
    Icon(graphics = {
    Rectangle(extent = {{-100, 100}, {100, -100}}, lineColor = {64, 64, 64}, fillColor = {255, 250, 235}, fillPattern = FillPattern.Solid, radius = 10),
    Rectangle(extent = {{-56, 30}, {4, -6}}, lineColor = {64, 64, 64}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid),
    Line(points = {{-56, 30}, {-26, 10}, {4, 30}}, color = {64, 64, 64}),
    Text(extent = {{-94, 97}, {50, 73}}, textString = "%object", horizontalAlignment = TextAlignment.Left),
    Text(extent = {{-150, -110}, {150, -150}}, textString = "slave %position"),
    Text(extent = {{-150, 150}, {150, 110}}, textColor = {0, 0, 255}, textString = "%name")}),
    Documentation(info = "<html>
<p>
A partial block that has the icon of a request to the mailbox of a slave.
</p>
</html>"));
end SDO;
