within EtherCAT.Types;
type DriveReference = enumeration(
    Relative "Movement from where the drive was enabled",
    Absolute "Angle of the drive, approached with a limited speed at first")
  "Meaning of the reference of a position"
  annotation (Documentation(info = "<html>
<p>
With both, a drive does not jump when it is enabled. <code>Relative</code>: the target is the angle at which the
drive was enabled plus the change of the reference since then. <code>Absolute</code>: the target begins at the
actual angle and goes to the reference with <code>approachSpeed</code>; once there, it follows the reference
without a limit. In profile position the drive itself limits the speed, by its object 0x6081.
</p>
</html>"));
