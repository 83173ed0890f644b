within EtherCAT.Interfaces;
connector VoltageInput = Modelica.Blocks.Interfaces.RealInput(
    final quantity = "ElectricPotential", final unit = "V") "Voltage as input signal"
  annotation (Documentation(info = "<html>
<p>
A <code>RealInput</code> with the unit V: it connects to any Real signal without a unit, and a tool that
checks units reports a connection to another unit.
</p>
</html>"));
