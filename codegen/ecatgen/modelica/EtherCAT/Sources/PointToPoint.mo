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
      Line(points = {{-80, 78}, {-80, -80}}, color = {192, 192, 192}),
      Line(points = {{-90, -70}, {82, -70}}, color = {192, 192, 192}),
      Line(points = {{-80, -70}, {-60, -70}, {-20, 50}, {30, 50}, {70, -70}, {80, -70}}, color = {0, 0, 127})}));
end PointToPoint;
