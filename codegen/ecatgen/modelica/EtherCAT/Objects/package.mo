within EtherCAT;
package Objects "External objects that the blocks are made of"
  extends Modelica.Icons.Package;

  annotation (
    Icon(graphics = {
      Polygon(points = {{-50, 26}, {0, 50}, {50, 26}, {0, 2}}, lineColor = {64, 64, 64}, fillColor = {200, 224, 224}, fillPattern = FillPattern.Solid),
      Polygon(points = {{-50, 26}, {0, 2}, {0, -56}, {-50, -30}}, lineColor = {64, 64, 64}, fillColor = {95, 158, 160}, fillPattern = FillPattern.Solid),
      Polygon(points = {{50, 26}, {0, 2}, {0, -56}, {50, -30}}, lineColor = {64, 64, 64}, fillColor = {120, 180, 182}, fillPattern = FillPattern.Solid)}),
    Documentation(info = "<html>
<p>
These objects are for blocks of your own. The external objects depend on each other in the order
<code>Master</code>, <code>Domain</code>, <code>SlaveConfiguration</code>, <code>PDO</code>, as in the
paper on the DLR EtherCAT library; an <code>SDO</code> needs a <code>Master</code> only. The
<a href=\"modelica://EtherCAT.Functions\">functions</a> work on them. The
<a href=\"modelica://EtherCAT.UsersGuide\">user's guide</a> explains how the parts make a block.
</p>
</html>"));
end Objects;
