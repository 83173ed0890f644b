within EtherCAT.Conversions;
block IntegerToBooleans "Boolean signals from the bits of a word"
  extends Modelica.Blocks.Icons.BooleanBlock;

  parameter Integer n(min = 1, max = 31) = 8 "Number of bits";

  Modelica.Blocks.Interfaces.IntegerInput u "Word, not negative"
    annotation (Placement(transformation(extent = {{-140, -20}, {-100, 20}})));
  Modelica.Blocks.Interfaces.BooleanOutput y[n] "Bits, the lowest first"
    annotation (Placement(transformation(extent = {{100, -10}, {120, 10}})));
equation
  for i in 1:n loop
    y[i] = EtherCAT.Functions.bit(u, i - 1);
  end for;

  annotation (
    defaultComponentName = "integerToBooleans",
    Documentation(info = "<html>
<p>
<code>y[i]</code> is bit <code>i-1</code> of <code>u</code>: for entries whose bits have meanings of their
own, such as status words.
</p>
</html>"),
    Icon(graphics = {
      Text(extent = {{-86, 26}, {-26, -26}}, textColor = {255, 127, 0}, textString = "I"),
      Text(extent = {{26, 26}, {86, -26}}, textColor = {255, 0, 255}, textString = "B[]"),
      Polygon(points = {{-18, 4}, {2, 4}, {2, 12}, {20, 0}, {2, -12}, {2, -4}, {-18, -4}}, lineColor = {64, 64, 64}, fillColor = {64, 64, 64}, fillPattern = FillPattern.Solid)}));
end IntegerToBooleans;
