within EtherCAT;
block SDOReadReal "Read an object of a slave as a Real"
  extends EtherCAT.Interfaces.PartialSDOReal;

  Modelica.Blocks.Interfaces.RealOutput y(start = 0, fixed = true, final unit = unit)
    "Value of the object at the last successful request"
    annotation (Placement(transformation(extent = {{100, 70}, {120, 90}})));
equation
  when etherCATMaster.sampled[1] then
    state = EtherCAT.Functions.sdoRead(sdo, time, etherCATMaster.cycle, triggered);
    y = EtherCAT.Functions.sdoReal(sdo, state);
  end when;

  annotation (
    defaultComponentName = "sdoReadReal",
    Documentation(info = "<html>
<p>
Uploads an object of the slave at <code>position</code> through its mailbox. Its value times
<code>scale</code> plus <code>offset</code> arrives at <code>y</code> some bus cycles after the request,
when <code>done</code> becomes true and <code>count</code> advances; until then <code>y</code> is 0.
Integers are exact up to 2^53, and rounded beyond.
</p>
<p>
<a href=\"modelica://EtherCAT.Interfaces.PartialSDO\">PartialSDO</a> explains when the object is requested, and
what happens to a request that fails.
</p>
</html>"),
    Icon(graphics = {
      Text(extent = {{-80, -10}, {28, -34}}, textColor = {64, 64, 64}, textString = "read Real"),
      Text(extent = {{60, 92}, {95, 68}}, textColor = {64, 64, 64}, horizontalAlignment = TextAlignment.Right, textString = "y")}));
end SDOReadReal;
