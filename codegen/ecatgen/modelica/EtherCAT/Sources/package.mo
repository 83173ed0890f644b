within EtherCAT;
package Sources "Reference signals"
  extends Modelica.Icons.SourcesPackage;

  annotation (Documentation(info = "<html>
<p>
Sources whose signals have no events, so that they can be sampled as often as the bus needs it.
</p>
</html>"));
end Sources;
