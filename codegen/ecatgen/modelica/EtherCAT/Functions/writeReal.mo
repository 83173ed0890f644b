within EtherCAT.Functions;
impure function writeReal "Note the value of an entry for the commit of its slave"
  extends Modelica.Icons.Function;
  input EtherCAT.Objects.PDO pdo "Entry";
  input Real t "Simulation time";
  input Integer order "Any value whose computation must come before this call";
  input Real u "Value";
  output Integer done "Equal to order";
  external "C" done = ecatm_write_real(pdo, t, order, u)
    annotation (
      Include = "#include \"ecat_modelica.h\"",
      IncludeDirectory = "modelica://EtherCAT/Resources/Include",
      Library = "ecat",
      LibraryDirectory = "modelica://EtherCAT/Resources/Library");
end writeReal;
