within EtherCAT.CAN;
block SendFrame "Send the bytes of a CAN message"
  extends EtherCAT.Interfaces.PartialCANSend(final remote = isRemote);

  parameter Boolean isRemote = false
    "= true, if a remote frame is sent: it has no data, and length is what it asks for"
    annotation (choices(checkBox = true), Dialog(group = "Message"));

  Modelica.Blocks.Interfaces.IntegerInput u[8] "Bytes, 0 to 255; those beyond length are not sent"
    annotation (Placement(transformation(extent = {{-140, 40}, {-100, 80}})));
equation
  when sampled then
    written = EtherCAT.Functions.canWriteFrame(message, time, etherCATMaster.cycle, u);
  end when;

  annotation (
    defaultComponentName = "sendFrame",
    Icon(graphics = {
      Text(extent = {{-95, 72}, {-60, 48}}, textColor = {64, 64, 64}, horizontalAlignment = TextAlignment.Left, textString = "u")}),
    Documentation(info = "<html>
<p>
The frame of a message without signals, such as the NMT command <code>{1, 0, ...}</code> with <code>length = 2</code> and
identifier 0, which starts all nodes of a CANopen bus. With <code>OnTrigger</code> it is sent when the number at
<code>trigger</code> changes.
</p>
<p>
<a href=\"modelica://EtherCAT.Interfaces.PartialCANSend\">PartialCANSend</a> explains when messages are sent.
</p>
</html>"));
end SendFrame;
