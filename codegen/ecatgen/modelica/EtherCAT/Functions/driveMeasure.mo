within EtherCAT.Functions;
impure function driveMeasure "State and actual values of a drive in SI units"
  extends Modelica.Icons.Function;
  input EtherCAT.Objects.Drive drive "Drive";
  input Real t "Simulation time";
  input Integer order "Any value whose computation must come before this call";
  input Boolean valid "= true, if the following values are those of the slave";
  input Integer statusWord "Status word 0x6041";
  input Integer modeOfOperationDisplay "Mode of operation display 0x6061";
  input Integer position "Position actual value 0x6064";
  input Integer velocity "Velocity actual value 0x606C";
  input Integer torque "Torque actual value 0x6077";
  input Integer current "Current actual value 0x6078";
  output EtherCAT.Types.DriveState state "State";
  output Real phi "Angle of the output in rad";
  output Real w "Speed of the output in rad/s";
  output Real tau "Torque at the output in N.m";
  output Real i "Current of the motor in A";
  output Boolean enabled "= true, if the drive follows its reference";
  external "C" state = ecatm_drive_measure(drive, t, order, valid, statusWord, modeOfOperationDisplay, position, velocity, torque, current, phi, w, tau, i, enabled)
    annotation (
      Include = "#include \"ecat_modelica.h\"",
      IncludeDirectory = "modelica://EtherCAT/Resources/Include",
      Library = "ecat",
      LibraryDirectory = "modelica://EtherCAT/Resources/Library");

  annotation (Documentation(info = "<html>
<p>
Call it in each sample, after the reads of the slave. While <code>valid</code> is false the results stay as
they are.
</p>
</html>"));
end driveMeasure;
