within EtherCAT.Functions;
impure function startupListWrite "Write the objects of a list one after the other"
  extends Modelica.Icons.Function;
  input EtherCAT.Objects.StartupList list "Objects and values";
  input Real t "Simulation time";
  input Integer order "Any value whose computation must come before this call";
  input Boolean trigger "A rising edge begins the list";
  output Integer state "0: not begun yet, 1: busy, 2: done, 3: failed";
  external "C" state = ecatm_sdo_list_write(list, t, order, trigger)
    annotation (
      Include = "#include \"ecat_modelica.h\"",
      IncludeDirectory = "modelica://EtherCAT/Resources/Include",
      Library = "ecat",
      LibraryDirectory = "modelica://EtherCAT/Resources/Library");

  annotation (Documentation(info = "<html>
<p>
Never waits; the next object is written when the one before was accepted, and the list ends with the first
one that is refused. Call it in <code>when sampled</code>.
</p>
</html>"));
end startupListWrite;
