within EtherCAT.Interfaces;
partial block PartialSlave "Base of every block that stands for a slave"
  extends EtherCAT.Interfaces.PartialSampled;
  parameter EtherCAT.Objects.SlaveData slaveData "Place and identity of the slave"
    annotation (Dialog(tab = "Identity"));
  parameter String hwName = "" "Name of the slave, for error messages"
    annotation (Dialog(tab = "Identity"));
  parameter String fingerprint = "" "Fingerprint of the bus that the block was generated for, empty: it was written by hand"
    annotation (Dialog(tab = "Identity"));
  parameter String generateCommand = "ecatctl generate NAME DIR"
    "Command that generates the block again, for error messages"
    annotation (Dialog(tab = "Identity"));

  Modelica.Blocks.Interfaces.BooleanOutput valid(start = false, fixed = true)
    "= true, if the values of this sample are those of a cycle in which the slave took part in OP"
    annotation (Placement(transformation(extent = {{100, 70}, {120, 90}})));
  EtherCAT.Types.ALState alState(start = EtherCAT.Types.ALState.NotAvailable, fixed = true)
    "State of the slave";
  Integer alStatusCode(start = 0, fixed = true)
    "Why the slave has left a state: AL status code (ETG.1000.6), 0: no error";
protected
  parameter EtherCAT.Objects.Domain domain = EtherCAT.Objects.Domain(
    etherCATMaster.master, domainID, getInstanceName()) "Domain";
  parameter EtherCAT.Objects.SlaveConfiguration slaveConfiguration =
    EtherCAT.Objects.SlaveConfiguration(
      domain, slaveData.position, slaveData.name, slaveData.vendorID,
      slaveData.productCode, slaveData.revisionNumber, hwName, fingerprint,
      generateCommand, getInstanceName()) "Slave";
equation
  when sampled then
    (valid, alState, alStatusCode) = EtherCAT.Functions.slaveState(
      slaveConfiguration, time, etherCATMaster.cycle);
  end when;

  annotation (Documentation(info = "<html>
<p>
Registers one slave, and has its state. A block of your own extends it, and adds external objects
<a href=\"modelica://EtherCAT.Objects.PDO\">PDO</a> and the calls that the
<a href=\"modelica://EtherCAT.Functions\">functions</a> explain.
</p>
<p>
The slave is found by <code>slaveData.name</code>, or without a name at <code>slaveData.position</code>. The start of
the simulation fails with one sentence when another slave is found there;
<code>slaveData.revisionNumber = 0</code> accepts any revision.
</p>
<p>
<code>valid</code> is true while the daemon delivers, all slaves of the domain of the bus took part in the
cycle of the sample (their working counter is as expected), and this slave is in OP. Otherwise the values of
the block are the last good ones, or zero if there were none, and written values may not reach the slave.
</p>
<p>
The connector <code>valid</code> is in the top right corner of the icon. Icons of other sizes than usual
have that corner at (100,&nbsp;100), too.
</p>
</html>"));
end PartialSlave;
