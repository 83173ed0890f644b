within EtherCAT;
package Conversions "From physical values to those of process data"
  extends Modelica.Icons.Package;
end Conversions;
