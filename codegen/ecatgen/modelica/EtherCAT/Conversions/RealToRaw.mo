within EtherCAT.Conversions;
block RealToRaw "Raw value of an entry for a physical value"
  extends EtherCAT.Interfaces.PartialConversion(saturated(start = false, fixed = true));
  extends EtherCAT.Interfaces.PartialSampled;

  Modelica.Blocks.Interfaces.RealInput u "Physical value in SI units"
    annotation (Placement(transformation(extent = {{-140, -20}, {-100, 20}})));
  Modelica.Blocks.Interfaces.IntegerOutput y(start = 0, fixed = true)
    "Raw value, rounded and held in the range"
    annotation (Placement(transformation(extent = {{100, -10}, {120, 10}})));
protected
  discrete Real raw(start = 0, fixed = true) "Raw value before it is rounded";
equation
  when sampled then
    raw = range.rawMin + (u - range.min)/k;
    y = EtherCAT.Functions.nearestInteger(max(range.rawMin, min(range.rawMax, raw)));
    saturated = raw <= range.rawMin or raw >= range.rawMax;
  end when;

  annotation (
    defaultComponentName = "realToRaw",
    Documentation(info = "<html>
<p>
The inverse of <a href=\"modelica://EtherCAT.Conversions.RawToReal\">RawToReal</a>, for an analog output
whose block has raw values. It converts when a sample of its domain is taken, and so makes no event
for each step of the output. A value beyond the range is cut to its end, and <code>saturated</code> is true
then.
</p>
</html>"),
    Icon(graphics = {
      Text(extent = {{-86, 26}, {-26, -26}}, textColor = {0, 0, 127}, textString = "R"),
      Text(extent = {{26, 26}, {86, -26}}, textColor = {255, 127, 0}, textString = "raw"),
      Polygon(points = {{-18, 4}, {2, 4}, {2, 12}, {20, 0}, {2, -12}, {2, -4}, {-18, -4}}, lineColor = {64, 64, 64}, fillColor = {64, 64, 64}, fillPattern = FillPattern.Solid)}));
end RealToRaw;
