within EtherCAT.Interfaces;
connector AngleOutput = Modelica.Blocks.Interfaces.RealOutput(
    final quantity = "Angle", final unit = "rad") "Angle as output signal"
  annotation (Documentation(info = "<html>
<p>
A <code>RealOutput</code> with the unit rad: it connects to any Real signal without a unit, and a tool that
checks units reports a connection to another unit.
</p>
</html>"));
