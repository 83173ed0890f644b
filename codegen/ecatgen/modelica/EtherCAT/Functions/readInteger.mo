within EtherCAT.Functions;
impure function readInteger "Value of an entry in the sample of this time"
  extends Modelica.Icons.Function;
  input EtherCAT.Objects.PDO pdo "Entry";
  input Real t "Simulation time";
  input Integer order "Any value whose computation must come before this call";
  output Integer y "Value";
  external "C" y = ecatm_read_integer(pdo, t, order)
    annotation (
      Include = "#include \"ecat_modelica.h\"",
      IncludeDirectory = "modelica://EtherCAT/Resources/Include",
      Library = "ecat",
      LibraryDirectory = "modelica://EtherCAT/Resources/Library");
end readInteger;
