within EtherCAT;
package Types "Enumerations"
  extends Modelica.Icons.TypesPackage;
end Types;
