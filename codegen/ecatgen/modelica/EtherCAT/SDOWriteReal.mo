within EtherCAT;
block SDOWriteReal "Write a Real to an object of a slave"
  extends EtherCAT.Interfaces.PartialSDOReal;

  Modelica.Blocks.Interfaces.RealInput u(final unit = unit) "Value to write"
    annotation (Placement(transformation(extent = {{-140, -80}, {-100, -40}})));
equation
  when etherCATMaster.sampled[1] then
    state = EtherCAT.Functions.sdoWriteReal(
      sdo, time, etherCATMaster.cycle, triggered, u);
  end when;

  annotation (
    defaultComponentName = "sdoWriteReal",
    Documentation(info = "<html>
<p>
Downloads <code>(u - offset)/scale</code>, with the <code>u</code> of the request, to an object of the
slave at <code>position</code> through its mailbox; integer types get the nearest whole
number, of two equally near ones the even one. <code>done</code>
becomes true when the slave has accepted it. A value that the data type cannot hold ends the simulation.
</p>
<p>
<a href=\"modelica://EtherCAT.Interfaces.PartialSDO\">PartialSDO</a> explains when the object is requested, and
what happens to a request that fails.
</p>
</html>"),
    Icon(graphics = {
      Text(extent = {{-80, -10}, {28, -34}}, textColor = {64, 64, 64}, textString = "write Real"),
      Text(extent = {{-95, -48}, {-60, -72}}, textColor = {64, 64, 64}, horizontalAlignment = TextAlignment.Left, textString = "u")}));
end SDOWriteReal;
