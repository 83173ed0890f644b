within EtherCAT.Conversions;
block BooleansToInteger "Bits of a word from Boolean signals"
  extends Modelica.Blocks.Icons.IntegerBlock;

  parameter Integer n(min = 1, max = 31) = 8 "Number of bits";

  Modelica.Blocks.Interfaces.BooleanInput u[n] "Bits, the lowest first"
    annotation (Placement(transformation(extent = {{-140, -20}, {-100, 20}})));
  Modelica.Blocks.Interfaces.IntegerOutput y "Word"
    annotation (Placement(transformation(extent = {{100, -10}, {120, 10}})));
equation
  y = sum(if u[i] then integer(2^(i - 1)) else 0 for i in 1:n);

  annotation (
    defaultComponentName = "booleansToInteger",
    Documentation(info = "<html>
<p>
<code>y = sum(2^(i-1))</code> of all <code>i</code> for which <code>u[i]</code> is true: for entries whose
bits have meanings of their own, such as control words, and for models that treat the channels of a
digital terminal as one number.
</p>
</html>"),
    Icon(graphics = {
      Text(extent = {{-86, 26}, {-26, -26}}, textColor = {255, 0, 255}, textString = "B[]"),
      Text(extent = {{26, 26}, {86, -26}}, textColor = {255, 127, 0}, textString = "I"),
      Polygon(points = {{-18, 4}, {2, 4}, {2, 12}, {20, 0}, {2, -12}, {2, -4}, {-18, -4}}, lineColor = {64, 64, 64}, fillColor = {64, 64, 64}, fillPattern = FillPattern.Solid)}));
end BooleansToInteger;
