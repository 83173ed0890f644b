within EtherCAT.Drives;
package Utilities "Parts of drives"
  extends Modelica.Icons.UtilitiesPackage;

  annotation (Documentation(info = "<html>
<p>
Slaves that drive blocks of this library contain, and conversions between state machine and slave.
</p>
</html>"));
end Utilities;
