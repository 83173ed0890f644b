within EtherCAT.Types;
type DriveState = enumeration(
    NotReadyToSwitchOn "The drive starts",
    SwitchOnDisabled "Without power, may be switched on",
    ReadyToSwitchOn "Power may be applied",
    SwitchedOn "Power is applied, no torque",
    OperationEnabled "The drive follows its target",
    QuickStopActive "Stopped quickly",
    FaultReactionActive "A fault was detected, the drive stops",
    Fault "Without power because of a fault") "States of a drive (CiA 402)"
  annotation (Documentation(info = "<html>
<p>The state is part of the status word 0x6041.</p>
</html>"));
