within EtherCAT.Interfaces;
connector TemperatureInput = Modelica.Blocks.Interfaces.RealInput(
    final quantity = "ThermodynamicTemperature", final unit = "K") "Temperature as input signal"
  annotation (Documentation(info = "<html>
<p>
A <code>RealInput</code> with the unit K: it connects to any Real signal without a unit, and a tool that
checks units reports a connection to another unit.
</p>
</html>"));
