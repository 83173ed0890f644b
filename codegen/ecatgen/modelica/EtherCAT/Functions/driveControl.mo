within EtherCAT.Functions;
function driveControl "Control word that leads a CiA 402 drive into operation"
  extends Modelica.Icons.Function;
  input EtherCAT.Types.DriveState state "State of the drive";
  input Boolean enable "= true, if the drive shall be in operation";
  input Boolean resetFault "= true, if a fault is reset while enable is true";
  input Integer last "Control word of the sample before";
  output Integer controlWord "Control word 0x6040";
protected
  constant Integer shutdown = 6;
  constant Integer switchOn = 7;
  constant Integer enableOperation = 15;
  constant Integer faultReset = 128 "Acts on its rising edge";
algorithm
  if state == EtherCAT.Types.DriveState.Fault then
    controlWord := if enable and resetFault and last <> faultReset then faultReset else 0;
  elseif state == EtherCAT.Types.DriveState.NotReadyToSwitchOn or
      state == EtherCAT.Types.DriveState.FaultReactionActive or
      state == EtherCAT.Types.DriveState.QuickStopActive then
    controlWord := 0;
  elseif not enable or state == EtherCAT.Types.DriveState.SwitchOnDisabled then
    controlWord := shutdown;
  elseif state == EtherCAT.Types.DriveState.ReadyToSwitchOn then
    controlWord := switchOn;
  else
    controlWord := enableOperation;
  end if;
end driveControl;
