within EtherCAT.CAN;
block ReceiveSignal "Receive one signal of a CAN message"
  extends EtherCAT.Interfaces.PartialCANReceive;

  parameter Integer startBit(min = 0, max = 63) = 0
    "First bit: the lowest one, or with bigEndian the highest one, as in a DBC file"
    annotation (Dialog(group = "Signal"));
  parameter Integer bitLength(min = 1, max = 64) = 16 "Number of bits"
    annotation (Dialog(group = "Signal"));
  parameter Boolean bigEndian = false "= true, if the first byte has the highest bits (Motorola)"
    annotation (choices(checkBox = true), Dialog(group = "Signal"));
  parameter EtherCAT.Types.CANNumber number = EtherCAT.Types.CANNumber.Unsigned "What the bits are"
    annotation (Dialog(group = "Signal"));
  parameter Real scale = 1 "Value = bits * scale + offset" annotation (Dialog(group = "Signal"));
  parameter Real offset = 0 "See scale" annotation (Dialog(group = "Signal"));
  parameter String unit = "" "Unit of the value" annotation (Evaluate = true, Dialog(group = "Signal"));

  Modelica.Blocks.Interfaces.RealOutput y(final unit = unit, start = 0, fixed = true)
    "Value in the last frame; before the first one, that of bits that are 0"
    annotation (Placement(transformation(extent = {{100, 50}, {120, 70}})));
protected
  parameter EtherCAT.Objects.CANSignal signal = EtherCAT.Objects.CANSignal(
    message, "y", startBit, bitLength, bigEndian, Integer(number), scale, offset, -1e300, 1e300, unit,
    {0, 0, 0, 0, 0}) "Signal";
equation
  when sampled then
    y = EtherCAT.Functions.canReadReal(signal, time, etherCATMaster.cycle);
  end when;

  annotation (
    defaultComponentName = "receiveSignal",
    Icon(graphics = {
      Text(extent = {{60, 72}, {95, 48}}, textColor = {64, 64, 64}, horizontalAlignment = TextAlignment.Right, textString = "y")}),
    Documentation(info = "<html>
<p>
The signal that begins at <code>startBit</code> of the message with this <code>identifier</code>. Any number of blocks may
receive signals of one message. A Boolean is <code>y &gt; 0.5</code>.
</p>
<p>
<a href=\"modelica://EtherCAT.Interfaces.PartialCANReceive\">PartialCANReceive</a> explains <code>valid</code> and
<code>timeout</code>, <a href=\"modelica://EtherCAT.Objects.CANSignal\">CANSignal</a> how bits are counted.
</p>
</html>"));
end ReceiveSignal;
