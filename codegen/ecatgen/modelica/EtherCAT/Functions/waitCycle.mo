within EtherCAT.Functions;
impure function waitCycle "Take a sample, after waiting for the bus if the master does so"
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

  annotation (Documentation(info = "<html>
<p>
Waits for the bus if <code>waitForBus</code> of the master is true, then takes one image of all inputs. The <a
href=\"modelica://EtherCAT.EtherCATMaster\">EtherCATMaster</a> calls it whenever a domain is sampled. A second
call at the same time returns the same cycle.
</p>
</html>"));
end waitCycle;
