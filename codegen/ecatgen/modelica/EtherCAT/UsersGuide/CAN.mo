within EtherCAT.UsersGuide;
class CAN "CAN behind a terminal"
  extends Modelica.Icons.Information;

  annotation (Documentation(info = "<html>
<p>
Some terminals, such as an EL6751, have a CAN bus behind them. If the configuration of the daemon has a
<code>[slave.can]</code> table for one, models and programs send and receive CAN messages with it, any number of them at
the same time.
</p>
<table border=\"1\" cellspacing=\"0\" cellpadding=\"2\">
<tr><th>what</th><th>block</th></tr>
<tr><td>all signals of a DBC file, or the PDOs of a CANopen device (EDS)</td><td>the block of the terminal, generated
with <code>ecatctl generate NAME DIR --can SLAVE=FILE</code></td></tr>
<tr><td>one signal</td><td><a href=\"modelica://EtherCAT.CAN.ReceiveSignal\">ReceiveSignal</a>,
<a href=\"modelica://EtherCAT.CAN.SendSignal\">SendSignal</a></td></tr>
<tr><td>the bytes of one message</td><td><a href=\"modelica://EtherCAT.CAN.ReceiveFrame\">ReceiveFrame</a>,
<a href=\"modelica://EtherCAT.CAN.SendFrame\">SendFrame</a></td></tr>
<tr><td>error counters, bus-off</td><td><a href=\"modelica://EtherCAT.CAN.ChannelState\">ChannelState</a></td></tr>
</table>
<p>
Frames make no events: a sample of the EtherCATMaster takes all that have come until its cycle, and a message has
the values of its last frame. <a href=\"modelica://EtherCAT.Interfaces.PartialCANReceive\">PartialCANReceive</a> explains
when it is <code>valid</code>, <a href=\"modelica://EtherCAT.Interfaces.PartialCANSend\">PartialCANSend</a> when messages
are sent, and what happens when the model ends.
</p>
</html>"));
end CAN;
