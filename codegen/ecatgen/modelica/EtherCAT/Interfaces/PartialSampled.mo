within EtherCAT.Interfaces;
partial block PartialSampled "Base of every block that is sampled with a domain"
  parameter Integer domainID(min = 1) = 1
    "Domain of the block: number of a sample time of the EtherCATMaster";
protected
  outer EtherCAT.EtherCATMaster etherCATMaster "Connection to the bus";
  Boolean sampled = etherCATMaster.sampled[EtherCAT.Functions.domainIndex(
    domainID, size(etherCATMaster.sampled, 1))] "True at the sample instants of the domain";

  annotation (Documentation(info = "<html>
<p>
Put the equations for each sample of the domain into <code>when sampled then</code>.
</p>
</html>"));
end PartialSampled;
