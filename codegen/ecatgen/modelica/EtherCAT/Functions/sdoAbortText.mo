within EtherCAT.Functions;
impure function sdoAbortText "Why the last request has failed"
  extends Modelica.Icons.Function;
  input EtherCAT.Objects.SDO sdo "Object";
  input Integer order "Any value whose computation must come before this call";
  output String abortText "One sentence, empty if it has not failed";
  external "C" abortText = ecatm_sdo_abort_text(sdo, order)
    annotation (
      Include = "#include \"ecat_modelica.h\"",
      IncludeDirectory = "modelica://EtherCAT/Resources/Include",
      Library = "ecat",
      LibraryDirectory = "modelica://EtherCAT/Resources/Library");

  annotation (Documentation(info = "<html>
<p>
Changes nothing and may be called at any time; pass the <code>state</code> as <code>order</code>.
</p>
</html>"));
end sdoAbortText;
