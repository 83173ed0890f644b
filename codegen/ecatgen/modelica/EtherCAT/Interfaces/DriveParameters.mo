within EtherCAT.Interfaces;
partial block DriveParameters "Parameters of a drive with the device profile CiA 402"
  parameter EtherCAT.Types.DriveMode mode = EtherCAT.Types.DriveMode.CyclicVelocity
    "Mode of operation, which selects the kind of the reference"
    annotation (Evaluate = true, Dialog(group = "Operation"));
  parameter EtherCAT.Types.DriveReference reference = EtherCAT.Types.DriveReference.Relative
    "Meaning of the reference of a position"
    annotation (Dialog(group = "Operation", enable = mode == EtherCAT.Types.DriveMode.ProfilePosition or mode == EtherCAT.Types.DriveMode.CyclicPosition));
  parameter Modelica.Units.SI.AngularVelocity approachSpeed(min = 0) = 1
    "Largest speed on the way to an absolute position after enabling"
    annotation (Dialog(group = "Operation", enable = mode == EtherCAT.Types.DriveMode.CyclicPosition and reference == EtherCAT.Types.DriveReference.Absolute));
  parameter EtherCAT.Types.DriveRestart restart = EtherCAT.Types.DriveRestart.Edge
    "What enables the drive again after a loss, a fault or a quick stop"
    annotation (Dialog(group = "Operation"));
  parameter Boolean useQuickStop = false "= true, if there is an input that stops the drive quickly"
    annotation (Evaluate = true, HideResult = true, choices(checkBox = true), Dialog(group = "Operation"));
  parameter Boolean useFaultReset = false
    "= true, if a separate input resets faults, and not switching enable on again"
    annotation (Evaluate = true, HideResult = true, choices(checkBox = true), Dialog(group = "Operation"));

  parameter Boolean useHoming = false "= true, if there is an input that homes the drive"
    annotation (Evaluate = true, HideResult = true, choices(checkBox = true), Dialog(group = "Operation"));
  parameter Integer homingMethod(min = -128, max = 127) = 0
    "Homing method of CiA 402, or of the manufacturer (negative), written to 0x6098; 0: the drive has one"
    annotation (Dialog(group = "Operation", enable = useHoming));

  parameter Real encoderResolution(min = 0, start = 65536)
    "Increments of the position per revolution of the motor (0x608F)"
    annotation (Dialog(group = "Motor and gear"));
  parameter Real gearRatio = 1
    "Revolutions of the motor per revolution of the output; negative: it turns the other way"
    annotation (Dialog(group = "Motor and gear"));
  parameter Real velocityScale(min = 0) = encoderResolution
    "Value of the velocity at one revolution of the motor per second (encoderResolution: increments/s, 60: rpm)"
    annotation (Dialog(group = "Motor and gear"));
  parameter Modelica.Units.SI.Torque ratedTorque(min = 0, start = 1)
    "Rated torque of the motor, 1000 in the process data (0x6076)"
    annotation (Dialog(group = "Motor and gear"));
  parameter Modelica.Units.SI.Current ratedCurrent(min = 0, start = 1)
    "Rated current of the motor, 1000 in the process data (0x6075)"
    annotation (Dialog(group = "Motor and gear"));
  parameter Modelica.Units.SI.Torque tau_max(min = 0) = ratedTorque
    "Largest torque of the motor: limit of all target torques, and value of 0x6072 if the process data have it"
    annotation (Dialog(group = "Motor and gear"));

  parameter Integer startUp[:, 4] = fill(0, 0, 4)
    "Objects written by SDO before the drive is enabled: index, subindex, data type (number of a DataType), value"
    annotation (Dialog(tab = "Start-up"));
  parameter Modelica.Units.SI.AngularVelocity standstillSpeed(min = 0) = 0.5 / abs(gearRatio)
    "Speed below which a quick stop is over" annotation (Dialog(tab = "Advanced"));
  parameter Modelica.Units.SI.Time maxDropout(min = 0) = 0.01
    "Longest time without valid data of the slave; after that the drive is switched off"
    annotation (Dialog(tab = "Advanced"));
  parameter Integer domainID(min = 1) = 1
    "Domain of the slave: number of a sample time of the EtherCATMaster"
    annotation (Dialog(tab = "Advanced"));
protected
  final parameter Boolean positionMode = mode == EtherCAT.Types.DriveMode.ProfilePosition or mode == EtherCAT.Types.DriveMode.CyclicPosition
    "= true, if the reference is an angle" annotation (Evaluate = true);
  final parameter Boolean velocityMode = mode == EtherCAT.Types.DriveMode.ProfileVelocity or mode == EtherCAT.Types.DriveMode.CyclicVelocity
    "= true, if the reference is a speed" annotation (Evaluate = true);
  final parameter Boolean torqueMode = mode == EtherCAT.Types.DriveMode.ProfileTorque or mode == EtherCAT.Types.DriveMode.CyclicTorque
    "= true, if the reference is a torque" annotation (Evaluate = true);

  annotation (Documentation(info = "<html>
<p>
The parameters of a drive, in one place for <a href=\"modelica://EtherCAT.Drives.CiA402\">CiA402</a> and for the
drives that contain it.
</p>
</html>"));
end DriveParameters;
