within EtherCAT.Interfaces;
connector TorqueInput = Modelica.Blocks.Interfaces.RealInput(
    final quantity = "Torque", final unit = "N.m") "Torque as input signal"
  annotation (Documentation(info = "<html>
<p>
A <code>RealInput</code> with the unit N.m: it connects to any Real signal without a unit, and a tool that
checks units reports a connection to another unit.
</p>
</html>"));
