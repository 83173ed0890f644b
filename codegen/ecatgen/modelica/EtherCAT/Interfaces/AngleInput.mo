within EtherCAT.Interfaces;
connector AngleInput = Modelica.Blocks.Interfaces.RealInput(
    final quantity = "Angle", final unit = "rad") "Angle as input signal"
  annotation (Documentation(info = "<html>
<p>
A <code>RealInput</code> with the unit rad: it connects to any Real signal without a unit, and a tool that
checks units reports a connection to another unit.
</p>
</html>"));
