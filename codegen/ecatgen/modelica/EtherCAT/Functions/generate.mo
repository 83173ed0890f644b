within EtherCAT.Functions;
impure function generate "Run ecatctl generate, and show what it says"
  extends Modelica.Icons.Function;
  input String ecatctl "Program";
  input String bus "Name of the bus";
  input String plantName "Name of the library";
  input String path "Folder that the library is put into";
  external "C" ecatm_generate(ecatctl, bus, plantName, path)
    annotation (
      Include = "#include \"ecatm_generate.h\"",
      IncludeDirectory = "modelica://EtherCAT/Resources/Include");

  annotation (Documentation(info = "<html>
<p>
A part of <a href=\"modelica://EtherCAT.generateConfiguration\">generateConfiguration</a>. No shell reads
the arguments, so names and folders may have any characters.
</p>
</html>"));
end generate;
