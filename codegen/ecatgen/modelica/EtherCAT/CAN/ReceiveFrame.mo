within EtherCAT.CAN;
block ReceiveFrame "Receive the bytes of a CAN message"
  extends EtherCAT.Interfaces.PartialCANReceive(final remote = isRemote);

  parameter Boolean isRemote = false "= true, if remote frames are received, which have no data"
    annotation (choices(checkBox = true), Dialog(group = "Message"));

  Modelica.Blocks.Interfaces.IntegerOutput y[8](each start = 0, each fixed = true)
    "Bytes of the last frame, 0 beyond its length"
    annotation (Placement(transformation(extent = {{100, 50}, {120, 70}})));
equation
  when sampled then
    y = {
      EtherCAT.Functions.canReadByte(message, time, etherCATMaster.cycle, 1),
      EtherCAT.Functions.canReadByte(message, time, etherCATMaster.cycle, 2),
      EtherCAT.Functions.canReadByte(message, time, etherCATMaster.cycle, 3),
      EtherCAT.Functions.canReadByte(message, time, etherCATMaster.cycle, 4),
      EtherCAT.Functions.canReadByte(message, time, etherCATMaster.cycle, 5),
      EtherCAT.Functions.canReadByte(message, time, etherCATMaster.cycle, 6),
      EtherCAT.Functions.canReadByte(message, time, etherCATMaster.cycle, 7),
      EtherCAT.Functions.canReadByte(message, time, etherCATMaster.cycle, 8)};
  end when;

  annotation (
    defaultComponentName = "receiveFrame",
    Icon(graphics = {
      Text(extent = {{60, 72}, {95, 48}}, textColor = {64, 64, 64}, horizontalAlignment = TextAlignment.Right, textString = "y")}),
    Documentation(info = "<html>
<p>
All bytes of the last frame with this <code>identifier</code>. <code>length</code> says how many there are.
<a href=\"modelica://EtherCAT.Interfaces.PartialCANReceive\">PartialCANReceive</a> explains <code>valid</code> and
<code>timeout</code>.
</p>
</html>"));
end ReceiveFrame;
