within EtherCAT.Functions;
impure function canSend "Send a CAN message if it is due"
  extends Modelica.Icons.Function;
  input EtherCAT.Objects.CANMessage message "Message";
  input Real t "Simulation time";
  input Integer order "Any value whose computation must come before this call";
  input Integer trigger "A message that is sent on a trigger leaves when this number changes";
  output Integer count "Frames that were handed over so far, modulo 2^31";
  external "C" count = ecatm_can_send(message, t, order, trigger)
    annotation (
      Include = "#include \"ecat_modelica.h\"",
      IncludeDirectory = "modelica://EtherCAT/Resources/Include",
      Library = "ecat",
      LibraryDirectory = "modelica://EtherCAT/Resources/Library");

  annotation (Documentation(info = "<html>
<p>
Decides once in a sample, however often it is called. If several blocks write signals of the message, it leaves when
the last of them has called this function. If one of them is not sampled at this time, it leaves before the next sample.
</p>
<p>
The first message that leaves makes the model a sender of the CAN channel, with the <code>lease</code> of the
EtherCATMaster. Without a bus, with <code>readOnly</code>, or while the terminal is not in OP or bus-off, nothing is sent.
</p>
</html>"));
end canSend;
