within EtherCAT.Functions;
impure function writeReal "Note the value of an entry for the commit of its slave"
  extends Modelica.Icons.Function;
  input EtherCAT.Objects.PDO pdo "Entry";
  input Real t "Simulation time";
  input Integer order "Any value whose computation must come before this call";
  input Real u "Value";
  output Integer done "Equal to order";
  external "C" done = ecatm_write_real(pdo, t, order, u)
    annotation (
      Include = "#include \"ecat_modelica.h\"",
      IncludeDirectory = "modelica://EtherCAT/Resources/Include",
      Library = "ecat",
      LibraryDirectory = "modelica://EtherCAT/Resources/Library");

  annotation (Documentation(info = "<html>
<p>
Writes <code>(value - offset)/scale</code>, with the numbers of the <a
href=\"modelica://EtherCAT.Objects.PDO\">PDO</a>; an integer entry gets the nearest whole number, of two equally near ones the even one. The value leaves with the <a
href=\"modelica://EtherCAT.Functions.commit\">commit</a> of the slave. Pass the result of the write before,
or the <code>cycle</code> of the EtherCATMaster, as <code>order</code>: so the calls have an order.
</p>
<p>
With a scale, an offset or a unit, a value out of range is held at the end of the range. Without them it is an error
of the commit.
</p>
</html>"));
end writeReal;
