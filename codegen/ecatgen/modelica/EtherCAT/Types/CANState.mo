within EtherCAT.Types;
type CANState = enumeration(
    Stopped "The terminal is not in OP, or does not take part in the exchange",
    ErrorActive "All is well",
    Warning "An error counter has reached 96",
    ErrorPassive "An error counter has reached 128",
    BusOff "It takes no part in the traffic") "State of a CAN controller"
  annotation (Documentation(info = "<html>
<p>
Output <code>state</code> of <a href=\"modelica://EtherCAT.CAN.ChannelState\">ChannelState</a>.
</p>
</html>"));
