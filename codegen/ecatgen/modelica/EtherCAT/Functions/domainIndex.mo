within EtherCAT.Functions;
function domainIndex "The index of a domain among the sample times of the EtherCATMaster"
  extends Modelica.Icons.Function;
  input Integer domainID "Number of the domain, 1 first";
  input Integer domains "Number of sample times";
  output Integer index "Equal to domainID";
algorithm
  assert(domainID >= 1 and domainID <= domains, "EtherCAT: there is no domain " + String(domainID) + ": sampleTime of the EtherCATMaster has length " + String(domains) + "; change domainID of the block, or add a sample time");
  index := domainID;

  annotation (Documentation(info = "<html>
<p>
Ends the simulation with a clear message if there is no such domain. Without this check the tool would report
an index out of bounds in the library, and not the mistake in the model.
</p>
</html>"));
end domainIndex;
