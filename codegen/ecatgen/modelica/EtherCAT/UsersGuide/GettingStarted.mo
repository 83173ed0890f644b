within EtherCAT.UsersGuide;
class GettingStarted "Getting started"
  extends Modelica.Icons.Information;

  annotation (Documentation(info = "<html>
<p>
You need Linux, the daemon <code>ecatd</code>, a Modelica tool with the Modelica Standard Library 4.0.0, and the
C compiler that the tool uses.
</p>
<h4>Without hardware</h4>
<ol>
<li>Start <code>ecatd --simulate troll</code>: a bus with a drive, digital and analog terminals.</li>
<li>Simulate <a href=\"modelica://EtherCAT.Examples.DigitalIO\">Examples.DigitalIO</a>, then the
other <a href=\"modelica://EtherCAT.Examples\">examples</a>. Each one says what to plot.</li>
</ol>
<h4>With the slaves of your bus</h4>
<ol>
<li>Start the daemon: <code>systemctl start ecatd</code>. <code>ecatctl slaves</code> shows what it has
found.</li>
<li>Generate their library: <code>ecatctl generate TrollPlant ~/models</code>, or, inside the tool,
<a href=\"modelica://EtherCAT.generateConfiguration\">generateConfiguration</a>. It needs no hardware
when it is given a saved scan or ESI files.</li>
<li>Load <code>~/models/EtherCAT/package.mo</code>, unless this library is loaded already, then
<code>~/models/TrollPlant/package.mo</code>.</li>
<li>Simulate <code>TrollPlant.Examples.AllSlaves</code>: it reads all inputs and keeps all outputs at
zero.</li>
</ol>
<h4>A model of your own</h4>
<ol>
<li>Drag in one <a href=\"modelica://EtherCAT.EtherCATMaster\">EtherCATMaster</a>. Set
<code>waitForBus = true</code> if the bus is to pace the model.</li>
<li>Drag in the blocks of the slaves that you use. On the left are the outputs of the bus, which the model
writes; on the right its inputs, which the model reads.</li>
<li>Connect them as any other block, and simulate.</li>
</ol>
</html>"));
end GettingStarted;
