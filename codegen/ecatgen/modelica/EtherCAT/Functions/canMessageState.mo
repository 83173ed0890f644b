within EtherCAT.Functions;
impure function canMessageState "State of a CAN message in the sample of this time"
  extends Modelica.Icons.Function;
  input EtherCAT.Objects.CANMessage message "Message";
  input Real t "Simulation time";
  input Integer order "Any value whose computation must come before this call";
  output Boolean valid "= true, if the last frame is new enough and the terminal takes part in both buses";
  output Real age "Time since the last frame in s, 1e9 before the first one";
  output Integer count "Frames that were received so far, modulo 2^31";
  output Integer missed "Frames that were too short, modulo 2^31";
  output Integer length "Bytes of data of the last frame";
  external "C" valid = ecatm_can_message(message, t, order, age, count, missed, length)
    annotation (
      Include = "#include \"ecat_modelica.h\"",
      IncludeDirectory = "modelica://EtherCAT/Resources/Include",
      Library = "ecat",
      LibraryDirectory = "modelica://EtherCAT/Resources/Library");

  annotation (Documentation(info = "<html>
<p>
Reads what the sample of this time has found, whichever block asked first; pass the <code>cycle</code> of
the EtherCATMaster as <code>order</code>. Call it in <code>when sampled</code>.
</p>
</html>"));
end canMessageState;
