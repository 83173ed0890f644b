within EtherCAT;
package Functions "Functions on external objects"
  extends Modelica.Icons.FunctionsPackage;

  annotation (Documentation(info = "<html>
<p>
These functions are for blocks of your own. In each sample a block first reads, with the cycle of the
<code>EtherCATMaster</code> as <code>order</code>, and then, in a when-equation of its own, writes and
commits:
</p>
<pre>
when sampled then
  y = readInteger(pdoY, time, etherCATMaster.cycle);
end when;
when sampled then
  written = writeInteger(pdoU, time, etherCATMaster.cycle, u);
  committed = commit(slaveConfiguration, time, written);
end when;
</pre>
<p>
Two when-equations, because in one the outputs would depend on the inputs, and a controller between
them would close a loop.
</p>
</html>"));
end Functions;
