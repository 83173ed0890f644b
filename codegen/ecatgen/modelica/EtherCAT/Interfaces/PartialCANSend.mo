within EtherCAT.Interfaces;
partial block PartialCANSend "Base of the blocks that send a CAN message"
  extends EtherCAT.Interfaces.PartialCAN;

  parameter Integer identifier(min = 0, max = 536870911) = 0 "Identifier of the message"
    annotation (Dialog(group = "Message"));
  parameter Boolean extended = identifier > 2047 "= true, if the identifier has 29 bits"
    annotation (choices(checkBox = true), Dialog(group = "Message"));
  parameter Integer length(min = 0, max = 8) = 8 "Bytes of data"
    annotation (Dialog(group = "Message"));
  parameter EtherCAT.Types.CANTransmission transmission = EtherCAT.Types.CANTransmission.OnChange
    "When it is sent" annotation (Dialog(group = "Sending"));
  parameter Modelica.Units.SI.Period period(min = 0) = 0
    "Time between two frames, by the clock of the bus; with OnChange, 0: only changes"
    annotation (Dialog(
      group = "Sending",
      enable = transmission == EtherCAT.Types.CANTransmission.Periodic or transmission == EtherCAT.Types.CANTransmission.OnChange));
  parameter Boolean reserve = false "= true, if no other client of the daemon may send this identifier"
    annotation (choices(checkBox = true), Dialog(group = "Sending"));

  Modelica.Blocks.Interfaces.IntegerInput trigger
    if transmission == EtherCAT.Types.CANTransmission.OnTrigger
    "The message is sent when this number differs from that of the last frame, 0 at the start"
    annotation (Placement(transformation(extent = {{-140, -80}, {-100, -40}})));
  output Integer count(start = 0, fixed = true) "Frames that were handed over to be sent, modulo 2^31";
protected
  parameter Boolean remote = false "= true, if remote frames are sent";
  parameter EtherCAT.Objects.CANMessage message = EtherCAT.Objects.CANMessage(
    slaveConfiguration, identifier, extended, remote, true, length, Integer(transmission), period, reserve, 0) "Message";
  Modelica.Blocks.Interfaces.IntegerInput triggered "Needed to connect to the conditional connector";
  Integer written(start = 0, fixed = true) "Order of the write";
equation
  connect(trigger, triggered);
  if transmission <> EtherCAT.Types.CANTransmission.OnTrigger then
    triggered = 0;
  end if;
  when sampled then
    count = EtherCAT.Functions.canSend(message, time, written, triggered);
  end when;

  annotation (
    Icon(graphics = {
      Text(extent = {{-95, -48}, {0, -72}}, textColor = {64, 64, 64}, horizontalAlignment = TextAlignment.Left, textString = "trigger", visible = transmission == EtherCAT.Types.CANTransmission.OnTrigger),
      Text(extent = {{-94, 97}, {94, 65}}, textString = "%identifier"),
      Polygon(points = {{-84, 20}, {-84, 0}, {-66, 10}}, lineColor = {64, 64, 64}, fillColor = {64, 64, 64}, fillPattern = FillPattern.Solid)}),
    Documentation(info = "<html>
<p>
The first frame makes the model a sender of the CAN channel, with the <code>lease</code> of the EtherCATMaster: if the
model dies, hangs or is paused for longer, its frames that wait are dropped, and the daemon sends the frames of
<code>[[slave.can.safe]]</code> in its configuration. Any number of models and programs may send on one channel.
</p>
<p>
A message is sent at most once in a sample. While the terminal is not in OP or bus-off, or there is no bus, it is not
sent, and does not wait either: the next frame has the values of its time.
</p>
</html>"));
end PartialCANSend;
