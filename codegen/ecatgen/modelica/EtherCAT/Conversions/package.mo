within EtherCAT;
package Conversions "From physical values to those of process data"
  extends Modelica.Icons.Package;

  annotation (
    Icon(graphics = {
    Rectangle(extent = {{-68, 24}, {-24, -20}}, lineColor = {255, 127, 0}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid),
    Polygon(points = {{-16, 7}, {2, 7}, {2, 16}, {18, 2}, {2, -12}, {2, -3}, {-16, -3}}, lineColor = {64, 64, 64}, fillColor = {64, 64, 64}, fillPattern = FillPattern.Solid),
    Rectangle(extent = {{26, 24}, {70, -20}}, lineColor = {0, 0, 127}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid)}),
    Documentation(info = "<html>
<p>
Values in process data are whole numbers; models have physical values. Blocks that were generated with a
device profile convert the values themselves. All other blocks need these conversions.
</p>
</html>"));
end Conversions;
