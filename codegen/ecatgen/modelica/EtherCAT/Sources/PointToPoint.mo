within EtherCAT.Sources;
block PointToPoint "Speed of a movement over a distance, as fast as limits allow"
  extends Modelica.Blocks.Icons.Block;

  parameter Real distance = 1 "Distance; negative: backwards";
  parameter Real maxSpeed(min = 0) = 1 "Largest speed (distance per second)";
  parameter Real maxAcceleration(min = 0) = 1 "Largest acceleration (distance per second squared)";
  parameter Modelica.Units.SI.Time startTime = 0 "Time at which the movement starts";

  Modelica.Blocks.Interfaces.RealOutput y "Speed"
    annotation (Placement(transformation(extent = {{100, -10}, {120, 10}})));
protected
  parameter Modelica.Units.SI.Time duration =
    if abs(distance) * maxAcceleration > maxSpeed * maxSpeed then
      abs(distance) / maxSpeed + maxSpeed / maxAcceleration
    else
      2 * sqrt(abs(distance) / maxAcceleration) "Duration of the movement";
equation
  y = sign(distance) * noEvent(max(0, min(maxSpeed, maxAcceleration * min(
    time - startTime, startTime + duration - time))));

  annotation (
    defaultComponentName = "pointToPoint",
    Documentation(info = "<html>
<p>
The speed rises with <code>maxAcceleration</code> up to <code>maxSpeed</code>, stays there, and falls
so that exactly <code>distance</code> is covered: a trapezoid, or a triangle when the distance is short.
The signal has no events, so that it costs nothing to sample it.
</p>
</html>"),
    Icon(graphics = {
      Line(points = {{-80, 68}, {-80, -80}}, color = {192, 192, 192}),
      Polygon(points = {{-80, 90}, {-88, 68}, {-72, 68}}, lineColor = {192, 192, 192}, fillColor = {192, 192, 192}, fillPattern = FillPattern.Solid),
      Line(points = {{-90, -70}, {68, -70}}, color = {192, 192, 192}),
      Polygon(points = {{90, -70}, {68, -62}, {68, -78}}, lineColor = {192, 192, 192}, fillColor = {192, 192, 192}, fillPattern = FillPattern.Solid),
      Line(points = {{-80, -70}, {-60, -70}, {-24, 50}, {24, 50}, {60, -70}, {70, -70}}),
      Text(extent = {{-150, -150}, {150, -110}}, textString = "startTime=%startTime")}));
end PointToPoint;
