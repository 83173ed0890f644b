within EtherCAT.Interfaces;
partial block PartialCANReceive "Base of the blocks that receive a CAN message"
  extends EtherCAT.Interfaces.PartialCAN;

  parameter Integer identifier(min = 0, max = 536870911) = 0 "Identifier of the message"
    annotation (Dialog(group = "Message"));
  parameter Boolean extended = identifier > 2047 "= true, if the identifier has 29 bits"
    annotation (choices(checkBox = true), Dialog(group = "Message"));
  parameter Integer minLength(min = 0, max = 8) = 0
    "Fewest bytes of data; shorter frames are left out, and counted by missed"
    annotation (Dialog(group = "Message"));
  parameter Modelica.Units.SI.Time timeout(min = 0) = 1
    "Time without a frame after which valid is false, 0: never"
    annotation (Dialog(group = "Message"));

  Modelica.Blocks.Interfaces.BooleanOutput valid(start = false, fixed = true)
    "= true, if the last frame is not older than timeout, and the terminal takes part in both buses"
    annotation (Placement(transformation(extent = {{100, -70}, {120, -50}})));
  output Modelica.Units.SI.Time age(start = 1e9, fixed = true)
    "Time since the last frame, 1e9 s before the first one";
  output Integer count(start = 0, fixed = true) "Frames that were received, modulo 2^31";
  output Integer missed(start = 0, fixed = true) "Frames that were too short, modulo 2^31";
  output Integer length(start = 0, fixed = true) "Bytes of data of the last frame";
protected
  parameter Boolean remote = false "= true, if remote frames are received";
  parameter EtherCAT.Objects.CANMessage message = EtherCAT.Objects.CANMessage(
    slaveConfiguration, identifier, extended, remote, false, minLength, 1, 0, false, timeout) "Message";
equation
  when sampled then
    (valid, age, count, missed, length) = EtherCAT.Functions.canMessageState(
      message, time, etherCATMaster.cycle);
  end when;

  annotation (
    Icon(graphics = {
      Text(extent = {{20, -48}, {95, -72}}, textColor = {64, 64, 64}, horizontalAlignment = TextAlignment.Right, textString = "valid"),
      Text(extent = {{-94, 97}, {94, 65}}, textString = "%identifier"),
      Polygon(points = {{66, 20}, {66, 0}, {84, 10}}, lineColor = {64, 64, 64}, fillColor = {64, 64, 64}, fillPattern = FillPattern.Solid)}),
    Documentation(info = "<html>
<p>
A sample takes the last frame that has come until the cycle of the sample, and makes no event of its own for a frame.
<code>count</code> says how many there were. Frames that other clients of the daemon have sent, such as <code>ecatctl
can send</code>, are received, too; those of this model are not.
</p>
<p>
<code>valid</code> is false before the first frame, when the last one is older than <code>timeout</code>, and when the
terminal is not in OP or bus-off; then it is true again only with the next frame. The values stay as they were.
</p>
</html>"));
end PartialCANReceive;
