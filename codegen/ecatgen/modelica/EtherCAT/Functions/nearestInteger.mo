within EtherCAT.Functions;
impure function nearestInteger "Nearest integer; halfway cases go to the even one"
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
Rounds in the same way as a write to an integer entry (IEEE 754, roundTiesToEven): 2.5 becomes 2, 3.5 becomes
4. A number that no Integer can hold ends the simulation.
</p>
</html>"));
end nearestInteger;
