within EtherCAT.Drives;
package Utilities "Parts of drives"
  extends Modelica.Icons.UtilitiesPackage;
end Utilities;
