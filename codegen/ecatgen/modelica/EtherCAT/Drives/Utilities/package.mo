within EtherCAT.Drives;
package Utilities "Parts of drives"
  extends Modelica.Icons.UtilitiesPackage;

  annotation (Documentation(info = "<html>
<p>
Parts of the drive blocks of this library: slaves, and conversions between state machine and slave.
</p>
</html>"));
end Utilities;
