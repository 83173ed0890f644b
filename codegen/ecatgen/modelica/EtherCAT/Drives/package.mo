within EtherCAT;
package Drives "Drives with the device profile CiA 402"
  extends Modelica.Icons.Package;

  annotation (
    Icon(graphics = {
    Rectangle(extent = {{-64, 36}, {24, -36}}, lineColor = {64, 64, 64}, fillColor = {95, 158, 160}, fillPattern = FillPattern.HorizontalCylinder),
    Rectangle(extent = {{24, 10}, {68, -10}}, lineColor = {64, 64, 64}, fillColor = {192, 192, 192}, fillPattern = FillPattern.HorizontalCylinder),
    Polygon(points = {{-70, -58}, {-44, -36}, {4, -36}, {30, -58}}, lineColor = {64, 64, 64}, fillColor = {128, 128, 128}, fillPattern = FillPattern.Solid)}),
    Documentation(info = "<html>
<p>
Blocks that lead a drive through the states of CiA&nbsp;402 and convert to SI units. Read <a
href=\"modelica://EtherCAT.UsersGuide.Drives\">the page on drives</a> first.
</p>
</html>"));
end Drives;
