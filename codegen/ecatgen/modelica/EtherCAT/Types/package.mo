within EtherCAT;
package Types "Enumerations"
  extends Modelica.Icons.TypesPackage;

  annotation (Documentation(info = "<html>
<p>
Enumerations and records of the parameters and variables of this library.
</p>
</html>"));
end Types;
