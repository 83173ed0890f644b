within EtherCAT;
block SDOWrite "Write an Integer to an object of a slave"
  extends EtherCAT.Interfaces.PartialSDOInteger;

  Modelica.Blocks.Interfaces.IntegerInput u "Value to write"
    annotation (Placement(transformation(extent = {{-140, -80}, {-100, -40}})));
equation
  when etherCATMaster.sampled[1] then
    state = EtherCAT.Functions.sdoWriteInteger(
      sdo, time, etherCATMaster.cycle, triggered, u);
  end when;

  annotation (
    defaultComponentName = "sdoWrite",
    Documentation(info = "<html>
<p>
Downloads the value that <code>u</code> has at the request to an object of the slave at
<code>position</code> through its mailbox. <code>done</code> becomes true when the slave has accepted
it. A value that the data type cannot hold ends the simulation.
</p>
<p>
<a href=\"modelica://EtherCAT.Interfaces.PartialSDO\">PartialSDO</a> explains when the object is requested, and
what happens to a request that fails.
</p>
</html>"),
    Icon(graphics = {
      Text(extent = {{-80, -10}, {28, -34}}, textColor = {64, 64, 64}, textString = "write"),
      Text(extent = {{-95, -48}, {-60, -72}}, textColor = {64, 64, 64}, horizontalAlignment = TextAlignment.Left, textString = "u")}));
end SDOWrite;
