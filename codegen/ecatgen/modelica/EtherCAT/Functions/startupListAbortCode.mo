within EtherCAT.Functions;
impure function startupListAbortCode "Reason for the failure of an object of the list, as a code"
  extends Modelica.Icons.Function;
  input EtherCAT.Objects.StartupList list "Objects and values";
  input Integer order "Any value whose computation must come before this call";
  output Integer abortCode "SDO abort code, negative: no answer, 0: it has not failed";
  external "C" abortCode = ecatm_sdo_list_abort_code(list, order)
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
end startupListAbortCode;
