within EtherCAT.Types;
type DriveMode = enumeration(
    ProfilePosition "Move to a position on a profile of the drive",
    Velocity "Velocity mode of frequency converters",
    ProfileVelocity "Reach a speed on a profile of the drive",
    ProfileTorque "Reach a torque on a profile of the drive",
    Reserved "Not used by CiA 402",
    Homing "Search the reference position",
    InterpolatedPosition "Follow interpolated positions",
    CyclicPosition "Follow a new position in every cycle (CSP)",
    CyclicVelocity "Follow a new speed in every cycle (CSV)",
    CyclicTorque "Follow a new torque in every cycle (CST)")
  "Modes of operation of CiA 402; Integer(mode) is the value of object 0x6060"
  annotation (Documentation(info = "<html>
<p>The value of object 0x6060 for each mode is <code>Integer(mode)</code>.</p>
</html>"));
