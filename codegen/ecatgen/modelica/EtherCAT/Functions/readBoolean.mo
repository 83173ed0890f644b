within EtherCAT.Functions;
impure function readBoolean "Value of an entry in the sample of this time"
  extends Modelica.Icons.Function;
  input EtherCAT.Objects.PDO pdo "Entry";
  input Real t "Simulation time";
  input Integer order "Any value whose computation must come before this call";
  output Boolean y "Value";
  external "C" y = ecatm_read_boolean(pdo, t, order)
    annotation (
      Include = "#include \"ecat_modelica.h\"",
      IncludeDirectory = "modelica://EtherCAT/Resources/Include",
      Library = "ecat",
      LibraryDirectory = "modelica://EtherCAT/Resources/Library");

  annotation (Documentation(info = "<html>
<p>
True if any bit of the entry is set. Reads from the image of all inputs that the sample of this time has
taken, whichever block asked first; pass the <code>cycle</code> of the EtherCATMaster as <code>order</code>.
Call it in <code>when sampled</code>.
</p>
</html>"));
end readBoolean;
