within EtherCAT;
impure function generateConfiguration "Generate the library of the slaves of a bus"
  extends Modelica.Icons.Function;
  input String plantName "Name of the library, for example TrollPlant";
  input String path = "." "Folder that the library is put into; ~ is the home folder";
  input String bus = "ecat0" "Name of the bus, as given to ecatd";
  input String ecatctl = "ecatctl" "Program, found on the PATH of the Modelica tool, or its path";
  output String packageFile "File to load";
protected
  String folder "Full path of the folder";
algorithm
  folder := Modelica.Utilities.Files.fullPathName(
    if path == "~" or Modelica.Utilities.Strings.substring(path + "  ", 1, 2) == "~/" then
      Modelica.Utilities.System.getEnvironmentVariable("HOME")
        + Modelica.Utilities.Strings.substring(path + " ", 2, Modelica.Utilities.Strings.length(path))
    else
      path);
  EtherCAT.Functions.generate(ecatctl, bus, plantName, folder);
  packageFile := folder + "/" + plantName + "/package.mo";

  annotation (Documentation(info = "<html>
<p>
Runs <code>ecatctl generate</code>, which asks the daemon for the slaves of its bus and writes the library
<code>plantName</code> and a copy of this library into the folder <code>path</code>. Its output is shown as a
message. If it fails, nothing was written, and its error message is the error of this function.
</p>
<p>
The result is the file to load:
</p>
<table border=\"1\" cellspacing=\"0\" cellpadding=\"2\">
<tr><th>tool</th><th>commands</th></tr>
<tr><td>OpenModelica: script, OMShell</td>
<td><code>setCommandLineOptions(\"-d=gen\");<br>
file := EtherCAT.generateConfiguration(\"TrollPlant\", \"~/models\");<br>
loadFile(file);</code></td></tr>
<tr><td>Dymola: command window</td>
<td><code>openModel(EtherCAT.generateConfiguration(\"TrollPlant\", \"~/models\"))</code></td></tr>
<tr><td>dialog of the function in any tool</td>
<td>call it, then open the file that it returns</td></tr>
</table>
<p>
Without <code>-d=gen</code> OpenModelica 1.25 executes no external function outside of a simulation, and only
says that the script has failed.
</p>
<p>
This function does not load the file itself: that needs a scripting function of the tool, and a library that
uses such a function is wrong in every other tool.
</p>
</html>"));
end generateConfiguration;
