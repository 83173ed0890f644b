within EtherCAT.Functions;
impure function driveCommand "Control word, mode and targets of a drive for a reference in SI units"
  extends Modelica.Icons.Function;
  input EtherCAT.Objects.Drive drive "Drive";
  input Real t "Simulation time";
  input EtherCAT.Types.DriveState state "State from driveMeasure(), which must be called first";
  input Boolean enable "= true, if the drive shall be in operation";
  input Boolean quickStop "= true, if the drive shall stop quickly";
  input Boolean faultReset "A rising edge resets a fault";
  input Boolean home "= true, if the drive shall home";
  input Real reference "Angle in rad, speed in rad/s or torque in N.m of the output, as the mode says";
  output Integer controlWord "Control word 0x6040";
  output Integer modeOfOperation "Mode of operation 0x6060";
  output Integer targetPosition "Target position 0x607A";
  output Integer targetVelocity "Target velocity 0x60FF";
  output Integer targetTorque "Target torque 0x6071";
  output Integer maxTorque "Max torque 0x6072";
  output Integer startUpState "Start-up list; 0: not begun yet, 1: busy, 2: done, 3: refused";
  output EtherCAT.Types.DriveHoming homing "How homing goes";
  output Boolean reached "= true, if the drive has reached its reference";
  external "C" controlWord = ecatm_drive_command(drive, t, state, enable, quickStop, faultReset, home, reference, modeOfOperation, targetPosition, targetVelocity, targetTorque, maxTorque, startUpState, homing, reached)
    annotation (
      Include = "#include \"ecat_modelica.h\"",
      IncludeDirectory = "modelica://EtherCAT/Resources/Include",
      Library = "ecat",
      LibraryDirectory = "modelica://EtherCAT/Resources/Library");

  annotation (Documentation(info = "<html>
<p>
Call it after <a href=\"modelica://EtherCAT.Functions.driveMeasure\">driveMeasure</a> in a when-equation of
its own, with the <code>state</code> that <code>driveMeasure</code> returns.
<a href=\"modelica://EtherCAT.Drives.CiA402\">CiA402</a> explains the order of states.
</p>
</html>"));
end driveCommand;
