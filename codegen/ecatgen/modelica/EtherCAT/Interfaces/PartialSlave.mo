within EtherCAT.Interfaces;
partial block PartialSlave "Base of every block that stands for a slave"
  parameter Integer domainID(min = 1) = 1
    "Domain of the slave: number of a sample time of the EtherCATMaster";
  parameter EtherCAT.Objects.SlaveData slaveData "Place and identity of the slave"
    annotation (Dialog(tab = "Identity"));
  parameter String slaveName = "" "Name of the slave, for error messages"
    annotation (Dialog(tab = "Identity"));
  parameter String fingerprint = "" "Fingerprint of the bus that the block was generated for"
    annotation (Dialog(tab = "Identity"));
  parameter String generateCommand = "ecatctl generate NAME DIR"
    "Command that generates the block again, for error messages"
    annotation (Dialog(tab = "Identity"));
protected
  outer EtherCAT.EtherCATMaster etherCATMaster;
  parameter EtherCAT.Objects.Domain domain = EtherCAT.Objects.Domain(
    etherCATMaster.master, domainID);
  parameter EtherCAT.Objects.SlaveConfiguration slaveConfiguration =
    EtherCAT.Objects.SlaveConfiguration(
      domain, slaveData.position, slaveData.vendorID, slaveData.productCode,
      slaveData.revisionNumber, slaveName, fingerprint, generateCommand);
  annotation (Documentation(info = "<html>
<p>
Registers one slave. The start of the simulation fails with one sentence when another slave is found at
<code>slaveData.position</code>; <code>slaveData.revisionNumber = 0</code> accepts any revision.
</p>
</html>"));
end PartialSlave;
