within EtherCAT.Interfaces;
partial block PartialSDO "Base of the blocks that access one object of a slave"
  extends EtherCAT.Icons.SDO;

  parameter String slaveName = ""
    "Name of the slave in the configuration of ecatd; if empty, its position below"
    annotation (Dialog(group = "Object"));
  parameter Integer position(min = 0) = 0 "Position of the slave on the bus, 0 first"
    annotation (Dialog(group = "Object", enable = slaveName == ""));
  parameter String object = ""
    "Index and subindex in hexadecimal, such as \"0x6060:00\"; if empty, the two numbers below"
    annotation (Dialog(group = "Object"));
  parameter Integer index(min = 0, max = 65535) = 0 "Index of the object"
    annotation (Dialog(group = "Object", enable = object == ""));
  parameter Integer subindex(min = 0, max = 255) = 0 "Subindex of the object"
    annotation (Dialog(group = "Object", enable = object == ""));
  parameter Integer typeNumber "CoE data type of the object"
    annotation (Dialog(group = "Object"));
  parameter Integer valueType(min = 1, max = 3)
    "Type of the value in the block, 1: Integer, 2: Real, 3: String"
    annotation (Dialog(group = "Object"));
  parameter Real scale = 1 "Value of the block = value of the object * scale + offset"
    annotation (Dialog(group = "Scaling"));
  parameter Real offset = 0 "See scale" annotation (Dialog(group = "Scaling"));
  parameter EtherCAT.Types.Request request = EtherCAT.Types.Request.Triggered
    "When the object is requested" annotation (Dialog(group = "Request"));
  parameter Modelica.Units.SI.Period period = 1 "Time between two sampled requests"
    annotation (Dialog(
      group = "Request",
      enable = request == EtherCAT.Types.Request.Sampled));

  Modelica.Blocks.Interfaces.BooleanInput trigger
    if request == EtherCAT.Types.Request.Triggered
    "A rising edge, or true from the start, sends the request"
    annotation (Placement(transformation(extent = {{-140, 40}, {-100, 80}})));
  Modelica.Blocks.Interfaces.BooleanOutput done(start = false, fixed = true)
    "= true, if the last request succeeded"
    annotation (Placement(transformation(extent = {{100, 20}, {120, 40}})));
  Modelica.Blocks.Interfaces.BooleanOutput busy(start = false, fixed = true)
    "= true, while a request is running"
    annotation (Placement(transformation(extent = {{100, -40}, {120, -20}})));
  Modelica.Blocks.Interfaces.IntegerOutput abortCode(start = 0, fixed = true)
    "SDO abort code if the slave refused the last request, negative if it failed otherwise, else 0"
    annotation (Placement(transformation(extent = {{100, -90}, {120, -70}})));
  output String abortText(start = "", fixed = true) "Why the last request failed, else empty";
  output Integer count(start = 0, fixed = true) "Number of requests that succeeded";
protected
  outer EtherCAT.EtherCATMaster etherCATMaster "Connection to the bus";
  parameter EtherCAT.Objects.SDO sdo = EtherCAT.Objects.SDO(
    etherCATMaster.master, position, slaveName, index, subindex, typeNumber, valueType, Integer(request),
    period, scale, offset, object, getInstanceName()) "Object";
  Modelica.Blocks.Interfaces.BooleanInput triggered
    "Needed to connect to the conditional connector";
  Integer state(start = 0, fixed = true) "0: no request yet, 1: busy, 2: done, 3: failed";
equation
  connect(trigger, triggered);
  if request <> EtherCAT.Types.Request.Triggered then
    triggered = false;
  end if;
  when etherCATMaster.sampled[1] then
    busy = state == 1;
    done = state == 2;
    count = EtherCAT.Functions.sdoCount(sdo, state);
    abortCode = EtherCAT.Functions.sdoAbortCode(sdo, state);
    abortText = if state == 3 then EtherCAT.Functions.sdoAbortText(sdo, state) else "";
  end when;

  annotation (
    Icon(graphics = {
      Text(extent = {{-95, 72}, {-10, 48}}, textColor = {64, 64, 64}, horizontalAlignment = TextAlignment.Left, textString = "trigger", visible = request == EtherCAT.Types.Request.Triggered),
      Text(extent = {{20, 42}, {95, 18}}, textColor = {64, 64, 64}, horizontalAlignment = TextAlignment.Right, textString = "done"),
      Text(extent = {{30, -18}, {95, -42}}, textColor = {64, 64, 64}, horizontalAlignment = TextAlignment.Right, textString = "busy"),
      Text(extent = {{-20, -68}, {95, -92}}, textColor = {64, 64, 64}, horizontalAlignment = TextAlignment.Right, textString = "abortCode")}),
    Documentation(info = "<html>
<p>
Parameters and results of a request. A block that extends this one adds the value and the equation of
<code>state</code>, as <a href=\"modelica://EtherCAT.SDORead\">SDORead</a> does.
</p>
<h4>When the object is requested</h4>
<table border=\"1\" cellspacing=\"0\" cellpadding=\"2\">
<tr><th><code>request</code></th><th>requests</th></tr>
<tr><td>Triggered</td><td>each rising edge of <code>trigger</code>, and a trigger that is true from the
start</td></tr>
<tr><td>Sampled</td><td>at the start, and then every <code>period</code></td></tr>
<tr><td>Initial</td><td>once at the start, or as soon as there is a bus</td></tr>
</table>
<p>
The model goes on while the slave answers. No request delays the simulation, not even a request at the start.
Each sample of domain 1 checks whether the answer has come. Until then <code>busy</code> is true, and the block
ignores a further trigger or the end of a period. Any number of blocks may send requests at the same time:
requests of one model wait for each other. Outputs follow <code>trigger</code> within a sample. If a trigger
depends on <code>done</code> of the same block, put a <code>Modelica.Blocks.Logical.Pre</code> between them.
</p>
<h4>Requests that fail</h4>
<p>
A request that fails does not end the simulation: <code>abortCode</code> and <code>abortText</code> say
why, a value that was read before stays, and the log of the simulation has the sentence once.
</p>
<table border=\"1\" cellspacing=\"0\" cellpadding=\"2\">
<tr><th><code>abortCode</code></th><th>meaning</th></tr>
<tr><td>0</td><td>the last request has not failed</td></tr>
<tr><td>positive</td><td>SDO abort code of the slave (ETG.1000.6), such as 100794368 (0x06020000): there
is no such object</td></tr>
<tr><td>-1</td><td>the object is too long, or its length is not that of the <code>dataType</code></td></tr>
<tr><td>-2</td><td>there is no bus, or it ended during the request</td></tr>
<tr><td>-10</td><td>the value is too large for a Modelica Integer</td></tr>
<tr><td>-11</td><td>the slave did not answer in time</td></tr>
<tr><td>-12</td><td>the cycle of the bus stands still</td></tr>
<tr><td>-17</td><td>the slave has no CoE mailbox, or its AL state does not allow it</td></tr>
</table>
<p>
A mistake in the model ends the simulation: a slave that the bus does not have, a data type that the block
cannot use, and a value to be written that the data type cannot hold.
</p>
</html>"));
end PartialSDO;
