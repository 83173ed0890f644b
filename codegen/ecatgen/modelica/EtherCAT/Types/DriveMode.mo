within EtherCAT.Types;
type DriveMode = enumeration(
    ProfilePosition "Move to a position on a profile of the drive",
    ProfileVelocity "Reach a speed on a profile of the drive",
    ProfileTorque "Reach a torque on a profile of the drive",
    CyclicPosition "Follow a new position in every cycle (CSP)",
    CyclicVelocity "Follow a new speed in every cycle (CSV)",
    CyclicTorque "Follow a new torque in every cycle (CST)")
  "Modes of operation of a drive (CiA 402)"
  annotation (Documentation(info = "<html>
<p>
The values of object 0x6060 for these modes are 1, 3, 4, 8, 9 and 10. Object 0x6502 of a drive says which modes
it has: bit 0 stands for mode 1, bit 9 for mode 10.
</p>
</html>"));
