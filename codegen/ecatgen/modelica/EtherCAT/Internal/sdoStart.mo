within EtherCAT.Internal;
impure function sdoStart "Send a request to the mailbox of a slave"
  input EtherCAT.Internal.SDO sdo "Object";
  input Real t "Simulation time";
  input Boolean write "= true, if the value is written, else it is read";
  input Integer value "Value to write";
  output Integer state "1: busy";
  external "C" state = ecatm_sdo_start(sdo, t, write, value)
    annotation (
      Include = "#include \"ecat_modelica.h\"",
      IncludeDirectory = "modelica://EtherCAT/Resources/Include",
      Library = "ecat",
      LibraryDirectory = "modelica://EtherCAT/Resources/Library");
end sdoStart;
