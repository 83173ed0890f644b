within EtherCAT;
package Interfaces "Partial blocks"
  extends Modelica.Icons.InterfacesPackage;

  annotation (Documentation(info = "<html>
<p>
Base classes of the blocks of slaves, SDOs and conversions, and connectors with units.
</p>
</html>"));
end Interfaces;
