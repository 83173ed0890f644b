within EtherCAT;
block SDOWrite "Write an object of a slave when triggered"
  extends EtherCAT.Interfaces.PartialSDO;

  Modelica.Blocks.Interfaces.IntegerInput u "Value to write"
    annotation (Placement(transformation(extent = {{-140, -80}, {-100, -40}})));
equation
  when etherCATMaster.sampled[1] then
    state = EtherCAT.Functions.sdoWrite(sdo, time, etherCATMaster.cycle, trigger, u);
  end when;

  annotation (
    defaultComponentName = "sdoWrite",
    Documentation(info = "<html>
<p>
Downloads the value that <code>u</code> has when triggered to the object <code>index:subindex</code> of
the slave at <code>position</code> through the mailbox. <code>done</code> becomes true when the slave has
accepted it.
</p>
</html>"),
    Icon(graphics = {Text(extent = {{-90, 30}, {90, -30}}, textString = "SDO write")}));
end SDOWrite;
