within EtherCAT.Types;
type DriveHoming = enumeration(
    NotHomed "It was not homed by this model, or was lost since",
    Homes "It moves to find its reference",
    Homed "It has found its reference",
    Failed "It has not found it; the drive stands")
  "How homing of a drive goes"
  annotation (Documentation(info = "<html>
<p>
After <code>Failed</code>, switch <code>home</code> off and on to try again.
</p>
</html>"));
