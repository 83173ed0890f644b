within EtherCAT.UsersGuide;
class Errors "Errors"
  extends Modelica.Icons.Information;

  annotation (Documentation(info = "<html>
<p>
Every error is one sentence that begins with <code>EtherCAT:</code> and ends the simulation. If it is about a
block, the name of that block in the model comes next. The parameters <code>whenMissing</code> and
<code>whenFailed</code> of the <a href=\"modelica://EtherCAT.EtherCATMaster\">EtherCATMaster</a> select the
behaviour without a bus.
</p>
<table border=\"1\" cellspacing=\"0\" cellpadding=\"2\">
<tr><th>message</th><th>what to do</th></tr>
<tr><td>bus ... is not running</td><td>Start the daemon; check the parameter <code>bus</code> of the
EtherCATMaster.</td></tr>
<tr><td>no right to read bus ...</td><td>Become a member of the group of the daemon
(<code>sudo usermod -aG ecat $USER</code>), and log in again.</td></tr>
<tr><td>slave ... is ..., but this library was generated for ...</td><td>The bus has changed. Generate
the library again with the command in the message, or put the right slave back.
<code>slaveData.revisionNumber = 0</code> accepts any revision.</td></tr>
<tr><td>slave ... has no input ..., but this library uses it</td><td>Its process data have another mapping.
Generate the library again.</td></tr>
<tr><td>entry ... has ... bits ..., but this library was generated for ...</td><td>The same.</td></tr>
<tr><td>entry ... has values in ..., but this library was generated for ...</td><td>The configuration or a device
profile has another unit, scale or offset now. Generate the library again, or undo the change and start the daemon
again.</td></tr>
<tr><td>output ... of slave ... belongs to ...</td><td>Another program writes it: end that
first, or set <code>readOnly</code> of the EtherCATMaster if this model only watches. If it is this program, a
second EtherCATMaster of the model does.</td></tr>
<tr><td>slave ... is not in OP, but in ...</td><td>It has left OP, and <code>requireOperational</code> of the
EtherCATMaster is true; else this is a note. Look at the AL status code and at
<code>ecatctl slaves</code>.</td></tr>
<tr><td>two blocks of this model write the outputs of slave ...</td><td>Remove one of them.</td></tr>
<tr><td>... did not sample in time and lost its outputs ...</td><td>The simulation was slower than the
<code>lease</code> of the EtherCATMaster, or paused. The outputs are safe. Start again; make the model
faster, or the lease longer.</td></tr>
<tr><td>... is out of range for ...</td><td>Limit the signal before it reaches the block.</td></tr>
<tr><td>its sample time of ... is no multiple of the bus cycle</td><td>Change
<code>sampleTime</code> of the EtherCATMaster so that all its elements are multiples of one time that is a multiple of the
bus cycle; or do not wait for the bus.</td></tr>
<tr><td>the sample times ... are no multiples of one time ...</td><td>The same, for a model that does not wait, too: one
clock samples all domains, at most ten times as often as the fastest of them.</td></tr>
<tr><td>all sample times ... must be positive, the lease ... must not be negative</td><td>Change
<code>sampleTime</code> or <code>lease</code> of the EtherCATMaster.</td></tr>
<tr><td>entry ... is ..., which no Modelica Integer can hold</td><td>Read it by
<a href=\"modelica://EtherCAT.Functions.readReal\">readReal</a>.</td></tr>
<tr><td>object ... cannot be written, or requested ...</td><td>The data type, the value or the period of an SDO
block is wrong; the rest of the message says why.</td></tr>
<tr><td>the drive of slave ... cannot work: ...</td><td>A parameter of the drive makes no sense; the rest of the
message says which.</td></tr>
<tr><td>the drive of slave ... stays off until enable is switched off and on again, because ...</td><td>A note: the
drive was lost, had a fault, or left its operation by itself. See
<a href=\"modelica://EtherCAT.Types.DriveRestart\">DriveRestart</a>.</td></tr>
<tr><td>... is ..., but the drive of slave ... says ...</td><td>A note: correct this parameter of the drive block, or the
object of the drive.</td></tr>
<tr><td>the reference of the drive of slave ... is not a finite number</td><td>Look for a division by zero in the
model.</td></tr>
<tr><td>there is no domain ...</td><td><code>domainID</code> of a block is larger than the number of
sample times of the master.</td></tr>
<tr><td>the daemon of bus ... has ended</td><td>Start it again, then the simulation; or choose
<code>whenFailed</code>.</td></tr>
<tr><td>the cycle of bus ... stands still</td><td>The daemon hangs, or its machine sleeps: look at
<code>ecatctl stats</code> and the log of the daemon.</td></tr>
<tr><td>...; the model has waited for ... s, as long as patience ... allows</td><td>The bus did not come in
time. Start the daemon; make <code>patience</code> of the EtherCATMaster longer.</td></tr>
<tr><td>no library was generated: ...</td><td>The rest is the message of <code>ecatctl</code>.</td></tr>
<tr><td>the program ... cannot be started</td><td>Give <code>generateConfiguration</code> the path of
<code>ecatctl</code>.</td></tr>
</table>
<p>
A message that begins with <code>EtherCAT:</code> and does not end the simulation is a note: a slave that has left
OP or is back, an EtherCATMaster that no block uses because it is not called <code>etherCATMaster</code>, an SDO that a
slave has refused, a priority that the system does not permit, the loss of a bus, or its return.
</p>
</html>"));
end Errors;
