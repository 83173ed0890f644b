within EtherCAT.Functions;
impure function waitCycle "Take a sample, after waiting for the bus where the master does so"
  extends Modelica.Icons.Function;
  input EtherCAT.Objects.Master master "Connection";
  input Real t "Simulation time";
  output Integer cycle "Bus cycle of the sample";
  external "C" cycle = ecatm_wait(master, t)
    annotation (
      Include = "#include \"ecat_modelica.h\"",
      IncludeDirectory = "modelica://EtherCAT/Resources/Include",
      Library = "ecat",
      LibraryDirectory = "modelica://EtherCAT/Resources/Library");
end waitCycle;
