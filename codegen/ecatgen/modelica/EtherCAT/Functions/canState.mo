within EtherCAT.Functions;
impure function canState "State of a CAN channel in the sample of this time"
  extends Modelica.Icons.Function;
  input EtherCAT.Objects.SlaveConfiguration slaveConfiguration "Terminal";
  input Real t "Simulation time";
  input Integer order "Any value whose computation must come before this call";
  output EtherCAT.Types.CANState state "State of the CAN controller";
  output Integer sendErrors "Error counter of the controller for sending";
  output Integer receiveErrors "Error counter of the controller for receiving";
  output Integer received "Frames of other nodes since the start of the daemon";
  output Integer sent "Frames that were sent, by any client";
  output Integer waiting "Frames of this model that wait to be sent";
  output Integer overflows "How often the terminal has lost frames that it received";
  output Integer busOffs "How often the controller has gone bus-off";
  external "C" state = ecatm_can_state(slaveConfiguration, t, order, sendErrors, receiveErrors, received, sent, waiting, overflows, busOffs)
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
end canState;
