within EtherCAT.Icons;
partial block SDO "Icon of a request to the mailbox of a slave"
  annotation (Icon(graphics = {
    Rectangle(extent = {{-100, 100}, {100, -100}}, lineColor = {64, 64, 64}, fillColor = {255, 250, 235}, fillPattern = FillPattern.Solid, radius = 10),
    Rectangle(extent = {{-30, 44}, {30, 8}}, lineColor = {64, 64, 64}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid),
    Line(points = {{-30, 44}, {0, 24}, {30, 44}}, color = {64, 64, 64}),
    Text(extent = {{-90, 94}, {30, 74}}, textString = "%object"),
    Text(extent = {{-94, -72}, {10, -92}}, textString = "slave %position"),
    Text(extent = {{-150, 150}, {150, 110}}, textColor = {0, 0, 255}, textString = "%name")}));
end SDO;
