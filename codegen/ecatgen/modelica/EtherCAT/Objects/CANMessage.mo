within EtherCAT.Objects;
class CANMessage "One message of the CAN bus behind a terminal"
  extends ExternalObject;

  function constructor "Register a message"
    input EtherCAT.Objects.SlaveConfiguration slaveConfiguration "Terminal";
    input Integer identifier "Identifier";
    input Boolean extended "= true, if the identifier has 29 bits, else 11";
    input Boolean remote "= true, if it is a remote frame";
    input Boolean isSent "= true, if the model sends it, else the model receives it";
    input Integer length "Bytes of data; of a message that is received the fewest that make it valid";
    input Integer transmission "When it is sent: number of the EtherCAT.Types.CANTransmission";
    input Real period "Period in s with which it is sent";
    input Boolean reserve "= true, if no other client may send it";
    input Real timeout "Time in s after which a message that was received is not valid any more, 0: never";
    output CANMessage message "Message";
    external "C" message = ecatm_can_open(slaveConfiguration, identifier, extended, remote, isSent, length, transmission, period, reserve, timeout)
      annotation (
        Include = "#include \"ecat_modelica.h\"",
        IncludeDirectory = "modelica://EtherCAT/Resources/Include",
        Library = "ecat",
        LibraryDirectory = "modelica://EtherCAT/Resources/Library");
  end constructor;

  function destructor "Release it"
    input CANMessage message "Message";
    external "C" ecatm_can_close(message)
      annotation (
        Include = "#include \"ecat_modelica.h\"",
        IncludeDirectory = "modelica://EtherCAT/Resources/Include",
        Library = "ecat",
        LibraryDirectory = "modelica://EtherCAT/Resources/Library");
  end destructor;

  annotation (Documentation(info = "<html>
<p>
All frames with one identifier. Several objects with <code>isSent</code> and the same identifier are one
message: its frame has the signals of all of them. Their lengths, transmissions and periods must be equal.
</p>
<p>
The terminal must have a <code>[slave.can]</code> table in the configuration of the daemon.
</p>
</html>"));
end CANMessage;
