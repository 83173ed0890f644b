within EtherCAT.Interfaces;
connector AngularVelocityInput = Modelica.Blocks.Interfaces.RealInput(
    final quantity = "AngularVelocity", final unit = "rad/s") "Angular velocity as input signal"
  annotation (Documentation(info = "<html>
<p>
A <code>RealInput</code> with the unit rad/s: it connects to any Real signal without a unit, and a tool that
checks units reports a connection to another unit.
</p>
</html>"));
