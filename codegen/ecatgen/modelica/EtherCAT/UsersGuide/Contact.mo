within EtherCAT.UsersGuide;
class Contact "Contact"
  extends Modelica.Icons.Contact;

  annotation (Documentation(info = "<html>
<p>
The library is a part of the project ecatd and has its licence (MIT). Report errors and missing features to the
place where you have got ecatd from, with the error message and the output of <code>ecatctl info</code>.
</p>
<p>
It re-implements and extends the library that is described in: <em>The DLR EtherCAT Library: A template based
code-generation scheme for accessing real-time hardware from Modelica</em>.
</p>
</html>"));
end Contact;
