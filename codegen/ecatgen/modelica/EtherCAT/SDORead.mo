within EtherCAT;
block SDORead "Read an object of a slave as an Integer"
  extends EtherCAT.Interfaces.PartialSDOInteger;

  Modelica.Blocks.Interfaces.IntegerOutput y(start = 0, fixed = true)
    "Value of the object at the last successful request"
    annotation (Placement(transformation(extent = {{100, 70}, {120, 90}})));
equation
  when etherCATMaster.sampled[1] then
    state = EtherCAT.Functions.sdoRead(sdo, time, etherCATMaster.cycle, triggered);
    y = EtherCAT.Functions.sdoInteger(sdo, state);
  end when;

  annotation (
    defaultComponentName = "sdoRead",
    Documentation(info = "<html>
<p>
Uploads an object of the slave at <code>position</code> through its mailbox. Its value arrives at
<code>y</code> some bus cycles after the request, when <code>done</code> becomes true and
<code>count</code> advances; until then <code>y</code> is 0. A value that no Modelica Integer can hold is a
request that fails: use <a href=\"modelica://EtherCAT.SDOReadReal\">SDOReadReal</a>.
</p>
<p>
<a href=\"modelica://EtherCAT.Interfaces.PartialSDO\">PartialSDO</a> explains when the object is requested, and
what happens to a request that fails.
</p>
</html>"),
    Icon(graphics = {
      Text(extent = {{-80, -10}, {28, -34}}, textColor = {64, 64, 64}, textString = "read"),
      Text(extent = {{60, 92}, {95, 68}}, textColor = {64, 64, 64}, horizontalAlignment = TextAlignment.Right, textString = "y")}));
end SDORead;
