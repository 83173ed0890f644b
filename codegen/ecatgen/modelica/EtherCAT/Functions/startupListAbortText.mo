within EtherCAT.Functions;
impure function startupListAbortText "Which object of the list could not be written, and why"
  extends Modelica.Icons.Function;
  input EtherCAT.Objects.StartupList list "Objects and values";
  input Integer order "Any value whose computation must come before this call";
  output String abortText "One sentence, empty if it has not failed";
  external "C" abortText = ecatm_sdo_list_abort_text(list, order)
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
end startupListAbortText;
