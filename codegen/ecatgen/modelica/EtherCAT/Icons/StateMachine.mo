within EtherCAT.Icons;
partial block StateMachine "Icon of a state machine"
  annotation (
    Icon(graphics = {
    Rectangle(extent = {{-100, 100}, {100, -100}}, lineColor = {64, 64, 64}, fillColor = {240, 248, 248}, fillPattern = FillPattern.Solid, radius = 10),
    Ellipse(extent = {{-60, 70}, {-20, 30}}, lineColor = {64, 64, 64}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid),
    Ellipse(extent = {{20, 70}, {60, 30}}, lineColor = {64, 64, 64}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid),
    Ellipse(extent = {{-20, 0}, {20, -40}}, lineColor = {64, 64, 64}, fillColor = {95, 158, 160}, fillPattern = FillPattern.Solid),
    Line(points = {{-20, 50}, {20, 50}}, color = {64, 64, 64}, arrow = {Arrow.None, Arrow.Filled}),
    Line(points = {{40, 30}, {15, -5}}, color = {64, 64, 64}, arrow = {Arrow.None, Arrow.Filled}),
    Text(extent = {{-150, 150}, {150, 110}}, textColor = {0, 0, 255}, textString = "%name")}),
    Documentation(info = "<html>
<p>
A partial block that has the icon of a state machine.
</p>
</html>"));
end StateMachine;
