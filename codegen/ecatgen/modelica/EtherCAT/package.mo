within ;
package EtherCAT "Connection of models to EtherCAT hardware through the bus daemon ecatd"
  extends Modelica.Icons.Package;

  annotation (
    version = "0.1.0",
    uses(Modelica(version = "4.0.0")),
    preferredView = "info",
    Documentation(info = "<html>
<p>
Blocks that let a model read and write the process data of EtherCAT slaves. The bus itself belongs to
the daemon <code>ecatd</code>: a model may start, stop and fail while the bus stays in operation.
</p>
<p>
This library is the part that is the same for every bus. The blocks of the slaves of a certain bus are
generated: <code>ecatctl generate NAME DIR</code> writes a library <code>NAME</code> and a copy of this
one beside it. Begin with <a href=\"modelica://EtherCAT.UsersGuide.GettingStarted\">Getting started</a>.
</p>
</html>"),
    Icon(graphics = {
      Rectangle(extent = {{-70, 30}, {-30, -10}}, lineColor = {64, 64, 64}, fillColor = {95, 158, 160}, fillPattern = FillPattern.Solid),
      Rectangle(extent = {{-20, 30}, {20, -10}}, lineColor = {64, 64, 64}, fillColor = {95, 158, 160}, fillPattern = FillPattern.Solid),
      Rectangle(extent = {{30, 30}, {70, -10}}, lineColor = {64, 64, 64}, fillColor = {95, 158, 160}, fillPattern = FillPattern.Solid),
      Line(points = {{-80, -40}, {80, -40}}, color = {64, 64, 64}, thickness = 1),
      Line(points = {{-50, -10}, {-50, -40}}, color = {64, 64, 64}, thickness = 1),
      Line(points = {{0, -10}, {0, -40}}, color = {64, 64, 64}, thickness = 1),
      Line(points = {{50, -10}, {50, -40}}, color = {64, 64, 64}, thickness = 1)}));
end EtherCAT;
