within EtherCAT.Functions;
impure function commit "Hand the written values of a slave over to the bus, all at once"
  extends Modelica.Icons.Function;
  input EtherCAT.Objects.SlaveConfiguration slaveConfiguration "Slave";
  input Real t "Simulation time";
  input Integer order "Any value whose computation must come before this call";
  output Integer done "Equal to order";
  external "C" done = ecatm_commit(slaveConfiguration, t, order)
    annotation (
      Include = "#include \"ecat_modelica.h\"",
      IncludeDirectory = "modelica://EtherCAT/Resources/Include",
      Library = "ecat",
      LibraryDirectory = "modelica://EtherCAT/Resources/Library");
end commit;
