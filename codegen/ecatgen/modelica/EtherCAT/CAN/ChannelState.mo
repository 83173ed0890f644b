within EtherCAT.CAN;
block ChannelState "State of the CAN channel of a terminal"
  extends EtherCAT.Interfaces.PartialCAN;

  Modelica.Blocks.Interfaces.BooleanOutput operational(start = false, fixed = true)
    "= true, if the terminal is in OP and its CAN controller is not bus-off"
    annotation (Placement(transformation(extent = {{100, 50}, {120, 70}})));
  output EtherCAT.Types.CANState state(start = EtherCAT.Types.CANState.Stopped, fixed = true)
    "State of the CAN controller";
  output Integer sendErrors(start = 0, fixed = true) "Error counter of the controller for sending";
  output Integer receiveErrors(start = 0, fixed = true) "Error counter of the controller for receiving";
  output Integer received(start = 0, fixed = true)
    "Frames of other nodes since the start of the daemon, modulo 2^31";
  output Integer sent(start = 0, fixed = true)
    "Frames that were sent since the start of the daemon, by any client, modulo 2^31";
  output Integer waiting(start = 0, fixed = true) "Frames of this model that wait to be sent";
  output Integer overflows(start = 0, fixed = true)
    "How often the terminal has lost frames that it received";
  output Integer busOffs(start = 0, fixed = true) "How often the controller has gone bus-off";
equation
  when sampled then
    (state, sendErrors, receiveErrors, received, sent, waiting, overflows, busOffs) =
      EtherCAT.Functions.canState(slaveConfiguration, time, etherCATMaster.cycle);
    operational = state <> EtherCAT.Types.CANState.Stopped and state <> EtherCAT.Types.CANState.BusOff;
  end when;

  annotation (
    defaultComponentName = "channelState",
    Icon(graphics = {
      Text(extent = {{-20, 72}, {95, 48}}, textColor = {64, 64, 64}, horizontalAlignment = TextAlignment.Right, textString = "operational")}),
    Documentation(info = "<html>
<p>
What the terminal says about its CAN controller. The error counters are those of the CAN standard: a frame that
nobody acknowledges adds 8, a good one takes 1 away.
</p>
</html>"));
end ChannelState;
