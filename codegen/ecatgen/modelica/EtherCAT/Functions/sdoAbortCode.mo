within EtherCAT.Functions;
impure function sdoAbortCode "Reason for the failure of the last request, as a code"
  extends Modelica.Icons.Function;
  input EtherCAT.Objects.SDO sdo "Object";
  input Integer order "Any value whose computation must come before this call";
  output Integer abortCode "SDO abort code, negative: no answer, 0: it has not failed";
  external "C" abortCode = ecatm_sdo_abort_code(sdo, order)
    annotation (
      Include = "#include \"ecat_modelica.h\"",
      IncludeDirectory = "modelica://EtherCAT/Resources/Include",
      Library = "ecat",
      LibraryDirectory = "modelica://EtherCAT/Resources/Library");

  annotation (Documentation(info = "<html>
<p>
Changes nothing and may be called at any time; pass the <code>state</code> as <code>order</code>. The values
are explained in <a href=\"modelica://EtherCAT.Interfaces.PartialSDO\">PartialSDO</a>.
</p>
</html>"));
end sdoAbortCode;
