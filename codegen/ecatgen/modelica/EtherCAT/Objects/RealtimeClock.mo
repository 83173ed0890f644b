within EtherCAT.Objects;
class RealtimeClock "Clock that paces a model without a bus"
  extends ExternalObject;

  function constructor "Start a clock, and set the priority of the simulation"
    input Integer priority "Number of the EtherCAT.Types.ProcessPriority, 0: leave it as it is";
    output RealtimeClock realtimeClock "Clock";
    external "C" realtimeClock = ecatm_realtime_open(priority)
      annotation (
        Include = "#include \"ecat_modelica.h\"",
        IncludeDirectory = "modelica://EtherCAT/Resources/Include",
        Library = "ecat",
        LibraryDirectory = "modelica://EtherCAT/Resources/Library");
  end constructor;

  function destructor "Give the simulation its old priority"
    input RealtimeClock realtimeClock "Clock";
    external "C" ecatm_realtime_close(realtimeClock)
      annotation (
        Include = "#include \"ecat_modelica.h\"",
        IncludeDirectory = "modelica://EtherCAT/Resources/Include",
        Library = "ecat",
        LibraryDirectory = "modelica://EtherCAT/Resources/Library");
  end destructor;

  annotation (Documentation(info = "<html>
<p>
The clock of <a href=\"modelica://EtherCAT.SynchronizeRealtime\">SynchronizeRealtime</a>. If the system does
not permit the priority, a message says so.
</p>
</html>"));
end RealtimeClock;
