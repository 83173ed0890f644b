within EtherCAT;
block SDORead "Read an object of a slave when triggered"
  extends EtherCAT.Interfaces.PartialSDO;

  Modelica.Blocks.Interfaces.IntegerOutput y(start = 0, fixed = true)
    "Value of the object at the last successful request"
    annotation (Placement(transformation(extent = {{100, 70}, {120, 90}})));
equation
  when etherCATMaster.sampled[1] then
    state = EtherCAT.Functions.sdoRead(sdo, time, etherCATMaster.cycle, trigger);
    y = EtherCAT.Functions.sdoValue(sdo, state);
  end when;

  annotation (
    defaultComponentName = "sdoRead",
    Documentation(info = "<html>
<p>
Uploads the object <code>index:subindex</code> of the slave at <code>position</code> through the mailbox.
The value arrives at <code>y</code> some bus cycles after the trigger, when <code>done</code> becomes
true. A value that no Modelica Integer can hold ends the simulation with an error.
</p>
</html>"),
    Icon(graphics = {Text(extent = {{-90, 30}, {90, -30}}, textString = "SDO read")}));
end SDORead;
