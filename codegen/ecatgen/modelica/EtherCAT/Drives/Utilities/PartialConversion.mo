within EtherCAT.Drives.Utilities;
partial block PartialConversion "Base of the blocks between a state machine and entries with a unit"
  parameter Real scale = 1 "Physical value = raw value*scale + offset";
  parameter Real offset = 0 "See scale, in the unit of the physical value";

  annotation (
    Icon(graphics = {
      Rectangle(extent = {{-100, 100}, {100, -100}}, lineColor = {0, 0, 127}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid),
      Polygon(points = {{-60, 20}, {0, 20}, {0, 60}, {60, 0}, {0, -60}, {0, -20}, {-60, -20}}, lineColor = {64, 64, 64}, fillColor = {64, 64, 64}, fillPattern = FillPattern.Solid)}),
    Documentation(info = "<html>
<p>
The state machine of a drive uses raw values. If the daemon knows the unit of an entry, the block of the slave
has physical values, and one of these blocks connects the two.
</p>
</html>"));
end PartialConversion;
