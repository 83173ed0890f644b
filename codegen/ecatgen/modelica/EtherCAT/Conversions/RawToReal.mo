within EtherCAT.Conversions;
block RawToReal "Physical value of the raw value of an entry"
  extends EtherCAT.Interfaces.PartialConversion;

  Modelica.Blocks.Interfaces.IntegerInput u "Raw value, as in the process data"
    annotation (Placement(transformation(extent = {{-140, -20}, {-100, 20}})));
  Modelica.Blocks.Interfaces.RealOutput y "Physical value in SI units"
    annotation (Placement(transformation(extent = {{100, -10}, {120, 10}})));
equation
  y = range.min + k*(u - range.rawMin);
  saturated = u <= range.rawMin or u >= range.rawMax;

  annotation (
    defaultComponentName = "rawToReal",
    Documentation(info = "<html>
<p>
<code>y = range.min + (u - range.rawMin)*(range.max - range.min)/(range.rawMax - range.rawMin)</code>:
for an analog input whose block has raw values. Values beyond the range are converted, too.
<code>saturated</code> says that the signal at the terminal may be beyond the range.
</p>
<p>
A block that was generated with the device profile of the terminal has physical values already and
needs no conversion. Give the output a unit where it is used, for example
<code>RawToReal voltage(y(unit = \"V\"))</code>.
</p>
</html>"),
    Icon(graphics = {
      Text(extent = {{-86, 26}, {-26, -26}}, textColor = {255, 127, 0}, textString = "raw"),
      Text(extent = {{26, 26}, {86, -26}}, textColor = {0, 0, 127}, textString = "R"),
      Polygon(points = {{-18, 4}, {2, 4}, {2, 12}, {20, 0}, {2, -12}, {2, -4}, {-18, -4}}, lineColor = {64, 64, 64}, fillColor = {64, 64, 64}, fillPattern = FillPattern.Solid)}));
end RawToReal;
