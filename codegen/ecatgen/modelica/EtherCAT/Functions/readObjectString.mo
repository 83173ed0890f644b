within EtherCAT.Functions;
impure function readObjectString "Read an object and wait for the answer, for scripts"
  extends Modelica.Icons.Function;
  input String bus "Name of the bus, as given to ecatd";
  input Integer position "Position of the slave on the bus, 0 first";
  input String object "Index and subindex in hexadecimal, such as \"0x6060:00\"";
  input EtherCAT.Types.DataType dataType "Data type of the object";
  output String y "Value";
  external "C" y = ecatm_once_read_string(bus, position, object, dataType)
    annotation (
      Include = "#include \"ecat_modelica.h\"",
      IncludeDirectory = "modelica://EtherCAT/Resources/Include",
      Library = "ecat",
      LibraryDirectory = "modelica://EtherCAT/Resources/Library");

  annotation (Documentation(info = "<html>
<p>
For scripts and the command line of a tool, for instance
</p>
<pre>
EtherCAT.Functions.readObjectString(\"ecat0\", 0, \"0x1008:00\", EtherCAT.Types.DataType.VISIBLE_STRING)
</pre>
<p>
in OpenModelica after <code>setCommandLineOptions(\"-d=gen\")</code>. It connects to the bus, waits for the slave, and ends with one sentence if that fails. In models there is
<a href=\"modelica://EtherCAT.SDOReadString\">SDOReadString</a>, which waits for nothing.
</p>
</html>"));
end readObjectString;
