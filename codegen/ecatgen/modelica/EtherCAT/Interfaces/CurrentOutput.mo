within EtherCAT.Interfaces;
connector CurrentOutput = Modelica.Blocks.Interfaces.RealOutput(
    final quantity = "ElectricCurrent", final unit = "A") "Current as output signal"
  annotation (Documentation(info = "<html>
<p>
A <code>RealOutput</code> with the unit A: it connects to any Real signal without a unit, and a tool that
checks units reports a connection to another unit.
</p>
</html>"));
