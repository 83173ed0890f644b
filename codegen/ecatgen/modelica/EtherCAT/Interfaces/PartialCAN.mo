within EtherCAT.Interfaces;
partial block PartialCAN "Base of the blocks for the CAN bus behind a terminal"
  extends EtherCAT.Icons.CAN;
  extends EtherCAT.Interfaces.PartialSampled;

  parameter String slaveName = ""
    "Name of the terminal in the configuration of ecatd; if empty, its position below"
    annotation (Dialog(group = "Terminal"));
  parameter Integer position(min = 0) = 0 "Position of the terminal on the bus, 0 first"
    annotation (Dialog(group = "Terminal", enable = slaveName == ""));
protected
  parameter EtherCAT.Objects.Domain domain = EtherCAT.Objects.Domain(
    etherCATMaster.master, domainID, getInstanceName()) "Domain";
  parameter EtherCAT.Objects.SlaveConfiguration slaveConfiguration =
    EtherCAT.Objects.SlaveConfiguration(
      domain, position, slaveName, 0, 0, 0, "CAN terminal", "", "", getInstanceName()) "Terminal";

  annotation (
    Icon(graphics = {
      Text(extent = {{-150, -110}, {150, -150}}, textString = "slave %position", visible = slaveName == ""),
      Text(extent = {{-150, -110}, {150, -150}}, textString = "%slaveName", visible = slaveName <> "")}),
    Documentation(info = "<html>
<p>
The terminal, which may be any slave with a <code>[slave.can]</code> table in the configuration of the daemon. The block
that is generated for it, and any number of blocks like this one, may be in one model.
</p>
</html>"));
end PartialCAN;
