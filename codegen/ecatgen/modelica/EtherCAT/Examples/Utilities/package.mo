within EtherCAT.Examples;
package Utilities "Slaves of the simulated rig troll, as blocks that were written by hand"
  extends Modelica.Icons.UtilitiesPackage;

  annotation (Documentation(info = "<html>
<p>
The examples of this library need slaves, but no generated library. These blocks stand for some
slaves of the rig <code>troll</code>, which <code>ecatd --simulate troll</code> simulates. They also show how
blocks of one's own are made of the <a href=\"modelica://EtherCAT.Objects\">external objects</a>: read
<a href=\"modelica://EtherCAT.Examples.Utilities.EL1018\">EL1018</a> (reads) and
<a href=\"modelica://EtherCAT.Examples.Utilities.EL2008\">EL2008</a> (writes) first, then
<a href=\"modelica://EtherCAT.UsersGuide\">the user's guide</a>.
</p>
</html>"));
end Utilities;
