within EtherCAT.Types;
type DriveRestart = enumeration(
    Automatic "As soon as the drive is there again, and has no fault",
    Edge "After enable was switched off and on again")
  "What enables a drive again after a loss, a fault or a quick stop"
  annotation (Documentation(info = "<html>
<p>
A drive may be lost because its own cable breaks, because another slave of the bus is lost, because the model was too
late for its lease, or because the daemon ends. When it comes back, people may be at the machine. With <code>Edge</code>
it stays off until the model switches <code>enable</code> off and on. With <code>Automatic</code> it is enabled at once
while <code>enable</code> is true, and follows a reference of speed or torque at full size some cycles later.
</p>
<table border=\"1\" cellspacing=\"0\" cellpadding=\"2\">
<tr><th>while <code>enable</code> stays true</th><th>Edge</th><th>Automatic</th></tr>
<tr><td>first sample, the drive is switched off</td><td>starts</td><td>starts</td></tr>
<tr><td>first sample, the drive has a fault</td><td>waits</td><td>resets it, and starts</td></tr>
<tr><td>first sample, the drive is in operation already</td><td>waits</td><td>goes on</td></tr>
<tr><td>a fault, which goes</td><td>waits</td><td>starts when the fault is reset</td></tr>
<tr><td>a quick stop, which ends</td><td>waits</td><td>starts</td></tr>
<tr><td>the drive was lost, and comes back</td><td>waits</td><td>starts</td></tr>
<tr><td>the model was too late for its lease</td><td>waits</td><td>starts</td></tr>
<tr><td>the daemon was started again</td><td>waits</td><td>starts</td></tr>
<tr><td>the drive has left its operation by itself</td><td>waits</td><td>starts</td></tr>
</table>
<p>
A fault is reset by a change of <code>faultReset</code>, or of <code>enable</code> in its place, in both cases.
</p>
</html>"));
