within EtherCAT;
package Interfaces "Partial blocks"
  extends Modelica.Icons.InterfacesPackage;
end Interfaces;
