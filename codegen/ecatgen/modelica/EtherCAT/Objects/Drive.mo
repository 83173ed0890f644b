within EtherCAT.Objects;
class Drive "State machine, conversions and memory of a drive with the device profile CiA 402"
  extends ExternalObject;

  function constructor "Make the state machine of a drive"
    input EtherCAT.Objects.Master master "Connection";
    input Integer position "Position of the slave on the bus, 0 first";
    input String slaveName "Name of the slave in the configuration of ecatd, empty: by position";
    input Integer axis "Axis of the drive, 1 first";
    input EtherCAT.Types.DriveMode mode "Mode of operation";
    input EtherCAT.Types.DriveReference reference "Meaning of the reference of a position";
    input EtherCAT.Types.DriveRestart restart "What starts the drive again after a loss or a fault";
    input Integer entries
      "Mapped objects: 1 mode display + 2 position + 4 velocity + 8 torque + 16 current";
    input Integer modeObject "Index of the object to write the mode by SDO, 0 if it is in the process data";
    input Integer homingMethod "Homing method, 0: that of the drive";
    input Real encoderResolution "Increments per revolution of the motor";
    input Real gearRatio "Revolutions of the motor per revolution of the output";
    input Real velocityScale "Raw velocity at one revolution of the motor per second";
    input Real ratedTorque "Rated torque of the motor in N.m";
    input Real ratedCurrent "Rated current of the motor in A";
    input Real maxTorque "Largest torque of the motor in N.m";
    input Real approachSpeed "Largest speed towards an absolute reference in rad/s";
    input Real standstillSpeed "Speed in rad/s below which a quick stop is over";
    input Real maxDropout "Longest time without valid data, in s";
    input Integer startUp[:, 4]
      "Objects to write before the drive is enabled: index, subindex, data type, value";
    input String instance = "" "Name of the instance of the block, for messages";
    output Drive drive "Drive";
    external "C" drive = ecatm_drive_open(master, position, slaveName, axis, mode, reference, restart, entries, modeObject, homingMethod, encoderResolution, gearRatio, velocityScale, ratedTorque, ratedCurrent, maxTorque, approachSpeed, standstillSpeed, maxDropout, startUp, size(startUp, 1), size(startUp, 2), instance)
      annotation (
        Include = "#include \"ecat_modelica.h\"",
        IncludeDirectory = "modelica://EtherCAT/Resources/Include",
        Library = "ecat",
        LibraryDirectory = "modelica://EtherCAT/Resources/Library");
  end constructor;

  function destructor "Release it"
    input Drive drive "Drive";
    external "C" ecatm_drive_close(drive)
      annotation (
        Include = "#include \"ecat_modelica.h\"",
        IncludeDirectory = "modelica://EtherCAT/Resources/Include",
        Library = "ecat",
        LibraryDirectory = "modelica://EtherCAT/Resources/Library");
  end destructor;

  annotation (Documentation(info = "<html>
<p>
The external object in <a href=\"modelica://EtherCAT.Drives.CiA402\">CiA402</a>. It stores the position at which
the drive was enabled, and the progress of the start-up list.
</p>
</html>"));
end Drive;
