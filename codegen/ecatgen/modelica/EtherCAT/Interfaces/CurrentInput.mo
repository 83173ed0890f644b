within EtherCAT.Interfaces;
connector CurrentInput = Modelica.Blocks.Interfaces.RealInput(
    final quantity = "ElectricCurrent", final unit = "A") "Current as input signal"
  annotation (Documentation(info = "<html>
<p>
A <code>RealInput</code> with the unit A: it connects to any Real signal without a unit, and a tool that
checks units reports a connection to another unit.
</p>
</html>"));
