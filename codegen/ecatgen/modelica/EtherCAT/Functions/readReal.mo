within EtherCAT.Functions;
impure function readReal "Value of an entry in the sample of this time"
  extends Modelica.Icons.Function;
  input EtherCAT.Objects.PDO pdo "Entry";
  input Real t "Simulation time";
  input Integer order "Any value whose computation must come before this call";
  output Real y "Value";
  external "C" y = ecatm_read_real(pdo, t, order)
    annotation (
      Include = "#include \"ecat_modelica.h\"",
      IncludeDirectory = "modelica://EtherCAT/Resources/Include",
      Library = "ecat",
      LibraryDirectory = "modelica://EtherCAT/Resources/Library");

  annotation (Documentation(info = "<html>
<p>
Raw value times <code>scale</code> plus <code>offset</code> of the <a
href=\"modelica://EtherCAT.Objects.PDO\">PDO</a>; exact for integers up to 2^53. Reads from the image of all
inputs that the sample of this time has taken, whichever block asked first; pass the <code>cycle</code> of
the EtherCATMaster as <code>order</code>. Call it in <code>when sampled</code>.
</p>
</html>"));
end readReal;
