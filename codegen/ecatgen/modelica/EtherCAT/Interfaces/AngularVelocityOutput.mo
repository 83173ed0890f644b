within EtherCAT.Interfaces;
connector AngularVelocityOutput = Modelica.Blocks.Interfaces.RealOutput(
    final quantity = "AngularVelocity", final unit = "rad/s") "Angular velocity as output signal"
  annotation (Documentation(info = "<html>
<p>
A <code>RealOutput</code> with the unit rad/s: it connects to any Real signal without a unit, and a tool that
checks units reports a connection to another unit.
</p>
</html>"));
