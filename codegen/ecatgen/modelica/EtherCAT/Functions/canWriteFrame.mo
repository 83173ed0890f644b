within EtherCAT.Functions;
impure function canWriteFrame "Note the data of a CAN message"
  extends Modelica.Icons.Function;
  input EtherCAT.Objects.CANMessage message "Message";
  input Real t "Simulation time";
  input Integer order "Any value whose computation must come before this call";
  input Integer data[8] "Bytes, 0 to 255; those beyond the length of the message are not used";
  output Integer done "Equal to order";
  external "C" done = ecatm_can_write_frame(message, t, order, data)
    annotation (
      Include = "#include \"ecat_modelica.h\"",
      IncludeDirectory = "modelica://EtherCAT/Resources/Include",
      Library = "ecat",
      LibraryDirectory = "modelica://EtherCAT/Resources/Library");

  annotation (Documentation(info = "<html>
<p>
For messages without signals. The data leave with <a href=\"modelica://EtherCAT.Functions.canSend\">canSend</a>.
</p>
</html>"));
end canWriteFrame;
