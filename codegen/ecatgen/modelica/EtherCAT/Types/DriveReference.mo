within EtherCAT.Types;
type DriveReference = enumeration(
    Relative "Movement from where the drive was enabled",
    Absolute "Angle of the drive, approached with a limited speed at first")
  "What the reference of a position means"
  annotation (Documentation(info = "<html>
<p>
Neither lets a drive jump when it is enabled. <code>Relative</code>: the target is the actual angle plus
what the reference has moved since. <code>Absolute</code>: the target begins at the actual angle and goes
to the reference with <code>approachSpeed</code>; once there, it follows the reference without limit. In profile position it is the drive that limits the
speed, by its object 0x6081.
</p>
</html>"));
