within EtherCAT.UsersGuide;
class ReleaseNotes "Release notes"
  extends Modelica.Icons.ReleaseNotes;

  annotation (Documentation(info = "<html>
<h4>Version 0.1.0</h4>
<p>
The first version, for Modelica 3.4 and later and the Modelica Standard Library 4.0.0. Tried with OpenModelica
1.25.7.
</p>
</html>"));
end ReleaseNotes;
