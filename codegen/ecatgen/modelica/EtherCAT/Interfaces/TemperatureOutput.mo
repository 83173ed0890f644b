within EtherCAT.Interfaces;
connector TemperatureOutput = Modelica.Blocks.Interfaces.RealOutput(
    final quantity = "ThermodynamicTemperature", final unit = "K") "Temperature as output signal"
  annotation (Documentation(info = "<html>
<p>
A <code>RealOutput</code> with the unit K: it connects to any Real signal without a unit, and a tool that
checks units reports a connection to another unit.
</p>
</html>"));
