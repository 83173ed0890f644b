within EtherCAT;
package Examples "Models that can be simulated on the simulated rig troll"
  extends Modelica.Icons.ExamplesPackage;

  annotation (Documentation(info = "<html>
<p>
Start <code>ecatd --simulate troll</code> and simulate any of these models as it is. With hardware, use the
blocks of a generated library in the place of those in
<a href=\"modelica://EtherCAT.Examples.Utilities\">Utilities</a>.
</p>
</html>"));
end Examples;
