within EtherCAT.Functions;
function driveState "State of a CiA 402 drive in its status word"
  extends Modelica.Icons.Function;
  input Integer statusWord "Status word 0x6041";
  output EtherCAT.Types.DriveState state "State";
algorithm
  if bit(statusWord, 3) then
    state := if bit(statusWord, 2) then EtherCAT.Types.DriveState.FaultReactionActive
      else EtherCAT.Types.DriveState.Fault;
  elseif bit(statusWord, 6) then
    state := EtherCAT.Types.DriveState.SwitchOnDisabled;
  elseif not bit(statusWord, 0) then
    state := EtherCAT.Types.DriveState.NotReadyToSwitchOn;
  elseif not bit(statusWord, 5) then
    state := EtherCAT.Types.DriveState.QuickStopActive;
  elseif bit(statusWord, 2) then
    state := EtherCAT.Types.DriveState.OperationEnabled;
  elseif bit(statusWord, 1) then
    state := EtherCAT.Types.DriveState.SwitchedOn;
  else
    state := EtherCAT.Types.DriveState.ReadyToSwitchOn;
  end if;
end driveState;
