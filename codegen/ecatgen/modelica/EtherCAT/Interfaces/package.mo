within EtherCAT;
package Interfaces "Partial blocks"
  extends Modelica.Icons.InterfacesPackage;

  annotation (Documentation(info = "<html>
<p>
What blocks of slaves, of SDOs and of conversions have in common, and connectors with units.
</p>
</html>"));
end Interfaces;
