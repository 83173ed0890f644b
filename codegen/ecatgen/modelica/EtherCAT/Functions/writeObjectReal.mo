within EtherCAT.Functions;
impure function writeObjectReal "Write an object and wait for the answer, for scripts"
  extends Modelica.Icons.Function;
  input String bus "Name of the bus, as given to ecatd";
  input Integer position "Position of the slave on the bus, 0 first";
  input String object "Index and subindex in hexadecimal, such as \"0x6060:00\"";
  input EtherCAT.Types.DataType dataType "Data type of the object";
  input Real u "Value to write";
  external "C" ecatm_once_write_real(bus, position, object, dataType, u)
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
EtherCAT.Functions.writeObjectReal(\"ecat0\", 0, \"0x6081:00\", EtherCAT.Types.DataType.UNSIGNED32, 1e6)
</pre>
<p>
in OpenModelica after <code>setCommandLineOptions(\"-d=gen\")</code>. It connects to the bus, waits for the slave, and ends with one sentence if that fails. In models there is
<a href=\"modelica://EtherCAT.SDOWriteReal\">SDOWriteReal</a>, which waits for nothing.
</p>
</html>"));
end writeObjectReal;
