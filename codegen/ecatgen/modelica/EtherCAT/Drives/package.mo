within EtherCAT;
package Drives "Drives with the device profile CiA 402"
  extends Modelica.Icons.Package;
end Drives;
