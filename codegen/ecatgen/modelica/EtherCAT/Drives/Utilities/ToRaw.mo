within EtherCAT.Drives.Utilities;
block ToRaw "Raw value of an entry that the bus gives as a physical value"
  extends EtherCAT.Drives.Utilities.PartialConversion;
  extends EtherCAT.Interfaces.PartialSampled;

  Modelica.Blocks.Interfaces.RealInput u "Physical value"
    annotation (Placement(transformation(extent = {{-140, -20}, {-100, 20}})));
  Modelica.Blocks.Interfaces.IntegerOutput y(start = 0, fixed = true) "Raw value"
    annotation (Placement(transformation(extent = {{100, -20}, {140, 20}})));
equation
  when sampled then
    y = EtherCAT.Functions.nearestInteger((u - offset)/scale);
  end when;

  annotation (
    defaultComponentName = "toRaw",
    Documentation(info = "<html>
<p>
<code>y = (u - offset)/scale</code>: gives the state machine of a drive the number that the slave has sent.
The result of the division is a whole number except for a rounding error, which this block removes.
</p>
</html>"));
end ToRaw;
