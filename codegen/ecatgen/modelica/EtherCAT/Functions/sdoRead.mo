within EtherCAT.Functions;
impure function sdoRead "Read an object: send a request when it is due, or ask for its result"
  extends Modelica.Icons.Function;
  input EtherCAT.Objects.SDO sdo "Object";
  input Real t "Simulation time";
  input Integer order "Any value whose computation must come before this call";
  input Boolean trigger "A rising edge sends a triggered request";
  output Integer state "0: no request yet, 1: busy, 2: done, 3: failed";
  external "C" state = ecatm_sdo_read(sdo, t, order, trigger)
    annotation (
      Include = "#include \"ecat_modelica.h\"",
      IncludeDirectory = "modelica://EtherCAT/Resources/Include",
      Library = "ecat",
      LibraryDirectory = "modelica://EtherCAT/Resources/Library");

  annotation (Documentation(info = "<html>
<p>
Never waits. Call it in <code>when sampled</code>. <a
href=\"modelica://EtherCAT.SDORead\">SDORead</a> shows how.
</p>
</html>"));
end sdoRead;
