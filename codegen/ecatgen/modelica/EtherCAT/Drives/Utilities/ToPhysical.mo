within EtherCAT.Drives.Utilities;
block ToPhysical "Physical value of an entry that the bus takes as a physical value"
  extends EtherCAT.Drives.Utilities.PartialConversion;

  Modelica.Blocks.Interfaces.IntegerInput u "Raw value"
    annotation (Placement(transformation(extent = {{-140, -20}, {-100, 20}})));
  Modelica.Blocks.Interfaces.RealOutput y "Physical value"
    annotation (Placement(transformation(extent = {{100, -20}, {140, 20}})));
equation
  y = u*scale + offset;

  annotation (
    defaultComponentName = "toPhysical",
    Documentation(info = "<html>
<p>
<code>y = u*scale + offset</code>: converts a value of the state machine of a drive to the unit of the block of
the slave. This block converts it back, so that the slave gets <code>u</code>.
</p>
</html>"));
end ToPhysical;
