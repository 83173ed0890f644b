within EtherCAT.Interfaces;
connector TorqueOutput = Modelica.Blocks.Interfaces.RealOutput(
    final quantity = "Torque", final unit = "N.m") "Torque as output signal"
  annotation (Documentation(info = "<html>
<p>
A <code>RealOutput</code> with the unit N.m: it connects to any Real signal without a unit, and a tool that
checks units reports a connection to another unit.
</p>
</html>"));
