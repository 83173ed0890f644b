within EtherCAT.Internal;
impure function sdoPoll "Ask what became of the request"
  input EtherCAT.Internal.SDO sdo "Object";
  input Real t "Simulation time";
  output Integer state "1: busy, 2: done, 3: failed";
  output Integer value "Value that was read or written";
  output Integer abortCode "SDO abort code, negative: no answer";
  external "C" state = ecatm_sdo_poll(sdo, t, value, abortCode)
    annotation (
      Include = "#include \"ecat_modelica.h\"",
      IncludeDirectory = "modelica://EtherCAT/Resources/Include",
      Library = "ecat",
      LibraryDirectory = "modelica://EtherCAT/Resources/Library");
end sdoPoll;
