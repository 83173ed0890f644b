within EtherCAT.Functions;
impure function sdoReal "Value of the last successful read"
  extends Modelica.Icons.Function;
  input EtherCAT.Objects.SDO sdo "Object";
  input Integer order "Any value whose computation must come before this call";
  output Real y "Value, 0 at first";
  external "C" y = ecatm_sdo_real(sdo, order)
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
end sdoReal;
