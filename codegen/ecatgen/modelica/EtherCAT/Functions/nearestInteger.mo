within EtherCAT.Functions;
impure function nearestInteger "Nearest integer, of two equally near ones the even one"
  extends Modelica.Icons.Function;
  input Real u "Number";
  output Integer y "Nearest integer";
  external "C" y = ecatm_nearest_integer(u)
    annotation (
      Include = "#include \"ecat_modelica.h\"",
      IncludeDirectory = "modelica://EtherCAT/Resources/Include",
      Library = "ecat",
      LibraryDirectory = "modelica://EtherCAT/Resources/Library");

  annotation (Documentation(info = "<html>
<p>
As values are rounded that are written to an entry of integers (IEEE 754, roundTiesToEven): 2.5 becomes 2, 3.5
becomes 4. A number that no Integer can hold ends the simulation.
</p>
</html>"));
end nearestInteger;
