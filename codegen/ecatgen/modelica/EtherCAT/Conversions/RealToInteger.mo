within EtherCAT.Conversions;
block RealToInteger "Sample, scale and round a signal for an integer entry"
  extends Modelica.Blocks.Icons.IntegerBlock;
  extends EtherCAT.Interfaces.PartialSampled;

  parameter Real k = 1 "Gain";
  parameter Integer yMax = 2147483647 "Upper limit of the output";
  parameter Integer yMin = -yMax "Lower limit of the output";

  Modelica.Blocks.Interfaces.RealInput u "Signal"
    annotation (Placement(transformation(extent = {{-140, -20}, {-100, 20}})));
  Modelica.Blocks.Interfaces.IntegerOutput y(start = 0, fixed = true) "Rounded value of k*u"
    annotation (Placement(transformation(extent = {{100, -10}, {120, 10}})));
equation
  when sampled then
    y = EtherCAT.Functions.nearestInteger(max(yMin, min(yMax, k * u)));
  end when;

  annotation (
    defaultComponentName = "realToInteger",
    Documentation(info = "<html>
<p>
Rounds to the nearest integer; halfway cases go to the even one, as in entries. Unlike the block of the same
name in the Modelica Standard Library, this block converts only when a sample is taken, and so makes no event
for each step of the output.
</p>
</html>"),
    Icon(graphics = {
      Text(extent = {{-86, 26}, {-26, -26}}, textColor = {0, 0, 127}, textString = "R"),
      Text(extent = {{26, 26}, {86, -26}}, textColor = {255, 127, 0}, textString = "I"),
      Polygon(points = {{-18, 4}, {2, 4}, {2, 12}, {20, 0}, {2, -12}, {2, -4}, {-18, -4}}, lineColor = {64, 64, 64}, fillColor = {64, 64, 64}, fillPattern = FillPattern.Solid)}));
end RealToInteger;
