within EtherCAT.Objects;
class Master "Connection to a bus"
  extends ExternalObject;

  function constructor "Connect to a bus"
    input String bus "Name of the bus";
    input Boolean waitForBus "= true, if samples wait for bus cycles";
    input Real baseTime "Time between two samples of the bus in s";
    input Integer domains "Number of domains";
    input Real lease "Time without samples after which outputs become safe, in s";
    input Integer whenMissing "Number of the EtherCAT.Types.BusFailure: before there was a bus";
    input Integer whenFailed "Number of the EtherCAT.Types.BusFailure: after that";
    input Real patience "Longest time to wait for the bus in s, 0: for ever";
    input Boolean readOnly = false "= true, if nothing is written";
    input Boolean requireOperational = false
      "= true, if the simulation ends when a slave of the model is not in OP";
    input String instance = "" "Name of the instance of the block, for messages";
    output Master master "Connection";
    external "C" master = ecatm_master_open(bus, waitForBus, baseTime, domains, lease, whenMissing, whenFailed, patience, readOnly, requireOperational, instance)
      annotation (
        Include = "#include \"ecat_modelica.h\"",
        IncludeDirectory = "modelica://EtherCAT/Resources/Include",
        Library = "ecat",
        LibraryDirectory = "modelica://EtherCAT/Resources/Library");
  end constructor;

  function destructor "Release it"
    input Master master "Connection";
    external "C" ecatm_master_close(master)
      annotation (
        Include = "#include \"ecat_modelica.h\"",
        IncludeDirectory = "modelica://EtherCAT/Resources/Include",
        Library = "ecat",
        LibraryDirectory = "modelica://EtherCAT/Resources/Library");
  end destructor;

  annotation (Documentation(info = "<html>
<p>
The connection to a bus; the <a href=\"modelica://EtherCAT.EtherCATMaster\">EtherCATMaster</a> holds it. The end
of the connection releases all outputs that the model owns: they become safe.
</p>
</html>"));
end Master;
