within EtherCAT.Types;
type DriveRestart = enumeration(
    Automatic "As soon as the drive is there again, and has no fault",
    NeedsEdgeOfEnable "After enable was switched off and on again")
  "What enables a drive again after a loss or a fault"
  annotation (Documentation(info = "<html>
<p>
A drive may be lost because its own cable breaks, because another slave of the bus is lost, or because the daemon ends. When
it comes back, people may be at the machine. With <code>NeedsEdgeOfEnable</code> it stays off until the model
switches <code>enable</code> off and on. With <code>Automatic</code> it is enabled at once while <code>enable</code> is true, and follows
a reference of speed or torque at full size some cycles later.
</p>
<p>
A quick stop is no loss: the drive is enabled again when <code>quickStop</code> is false.
</p>
</html>"));
