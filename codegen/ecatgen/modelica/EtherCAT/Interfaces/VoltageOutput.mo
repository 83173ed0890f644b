within EtherCAT.Interfaces;
connector VoltageOutput = Modelica.Blocks.Interfaces.RealOutput(
    final quantity = "ElectricPotential", final unit = "V") "Voltage as output signal"
  annotation (Documentation(info = "<html>
<p>
A <code>RealOutput</code> with the unit V: it connects to any Real signal without a unit, and a tool that
checks units reports a connection to another unit.
</p>
</html>"));
