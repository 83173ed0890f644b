within EtherCAT.CAN;
block SendSignal "Send one signal of a CAN message"
  extends EtherCAT.Interfaces.PartialCANSend;

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
  parameter Real minimum = -1e300 "Smallest value that is sent" annotation (Dialog(group = "Signal"));
  parameter Real maximum = 1e300 "Largest value that is sent" annotation (Dialog(group = "Signal"));
  parameter String unit = "" "Unit of the value" annotation (Evaluate = true, Dialog(group = "Signal"));

  Modelica.Blocks.Interfaces.RealInput u(final unit = unit) "Value"
    annotation (Placement(transformation(extent = {{-140, 40}, {-100, 80}})));
protected
  parameter EtherCAT.Objects.CANSignal signal = EtherCAT.Objects.CANSignal(
    message, "u", startBit, bitLength, bigEndian, Integer(number), scale, offset, minimum, maximum, unit,
    {0, 0, 0, 0, 0}) "Signal";
equation
  when sampled then
    written = EtherCAT.Functions.canWriteReal(signal, time, etherCATMaster.cycle, u);
  end when;

  annotation (
    defaultComponentName = "sendSignal",
    Icon(graphics = {
      Text(extent = {{-95, 72}, {-60, 48}}, textColor = {64, 64, 64}, horizontalAlignment = TextAlignment.Left, textString = "u")}),
    Documentation(info = "<html>
<p>
The signal that begins at <code>startBit</code> of the message with this <code>identifier</code>. Blocks with the same
terminal and the same identifier make one frame together; <code>length</code> and all parameters of sending must be equal
in them, and two of them cannot have the same bits. Bits that no block writes are 0.
</p>
<p>
With a <code>scale</code>, an <code>offset</code> or a <code>unit</code>, a value beyond the limits is cut to them; without,
it ends the simulation with an error.
</p>
<p>
<a href=\"modelica://EtherCAT.Interfaces.PartialCANSend\">PartialCANSend</a> explains when messages are sent,
<a href=\"modelica://EtherCAT.Objects.CANSignal\">CANSignal</a> how bits are counted.
</p>
</html>"));
end SendSignal;
