within EtherCAT.Drives;
block StartUp "Set the mode of a CiA 402 drive and enable its operation"
  extends EtherCAT.Icons.StateMachine;

  parameter Integer position(min = 0) = 0 "Position of the drive on the bus, 0 first";
  parameter EtherCAT.Types.DriveMode mode = EtherCAT.Types.DriveMode.ProfileVelocity
    "Mode of operation";
  parameter Boolean writeMode = true
    "= true, if the mode is written to object 0x6060 by SDO before the drive is enabled"
    annotation (choices(checkBox = true));
  parameter Boolean resetFault = false "= true, if faults are reset while enable is true"
    annotation (choices(checkBox = true));

  Modelica.Blocks.Interfaces.BooleanInput enable "= true, if the drive shall be in operation"
    annotation (Placement(transformation(extent = {{-140, 40}, {-100, 80}})));
  Modelica.Blocks.Interfaces.IntegerInput statusWord "Status word 0x6041 of the drive"
    annotation (Placement(transformation(extent = {{-140, -80}, {-100, -40}})));
  Modelica.Blocks.Interfaces.IntegerOutput controlWord(start = 0, fixed = true)
    "Control word 0x6040 for the drive"
    annotation (Placement(transformation(extent = {{100, 70}, {120, 90}})));
  Modelica.Blocks.Interfaces.IntegerOutput modeOfOperation
    "Mode of operation 0x6060, for drives that have it in their process data"
    annotation (Placement(transformation(extent = {{100, 20}, {120, 40}})));
  Modelica.Blocks.Interfaces.BooleanOutput enabled(start = false, fixed = true)
    "= true, if the drive is in operation and follows its target"
    annotation (Placement(transformation(extent = {{100, -40}, {120, -20}})));
  Modelica.Blocks.Interfaces.IntegerOutput abortCode
    "SDO abort code if the drive refused the mode, else 0"
    annotation (Placement(transformation(extent = {{100, -90}, {120, -70}})));
  EtherCAT.Types.DriveState state(
    start = EtherCAT.Types.DriveState.NotReadyToSwitchOn,
    fixed = true) "State of the drive";
protected
  outer EtherCAT.EtherCATMaster etherCATMaster;
  EtherCAT.SDOWrite modeWrite(
    final position = position,
    final object = "0x6060:00",
    final dataType = EtherCAT.Types.DataType.INTEGER8) "Writes 0x6060";
  Modelica.Blocks.Sources.BooleanExpression modeTrigger(y = enable and writeMode);
  Boolean modeSet(start = false, fixed = true) "= true, if the drive has the mode";
equation
  connect(modeTrigger.y, modeWrite.trigger);
  modeWrite.u = Integer(mode);
  modeOfOperation = Integer(mode);
  abortCode = modeWrite.abortCode;
  when etherCATMaster.sampled[1] then
    state = EtherCAT.Functions.driveState(statusWord);
    modeSet = modeWrite.done or not writeMode;
    controlWord = EtherCAT.Functions.driveControl(
      state, enable and modeSet, resetFault, pre(controlWord));
    enabled = state == EtherCAT.Types.DriveState.OperationEnabled;
  end when;

  annotation (
    defaultComponentName = "startUp",
    Documentation(info = "<html>
<p>
First the mode of operation is written by SDO, as long as the drive is still off. Then the control word
leads the drive through the states of CiA&nbsp;402:
</p>
<table border=\"1\" cellspacing=\"0\" cellpadding=\"2\">
<tr><th>state of the drive</th><th>control word</th></tr>
<tr><td>Switch on disabled</td><td>6 (shutdown)</td></tr>
<tr><td>Ready to switch on</td><td>7 (switch on)</td></tr>
<tr><td>Switched on, Operation enabled</td><td>15 (enable operation)</td></tr>
<tr><td>Quick stop active</td><td>0 (disable voltage), and from the beginning</td></tr>
<tr><td>Fault</td><td>128 (fault reset) if <code>resetFault</code>, else 0</td></tr>
</table>
<p>
While <code>enable</code> is false the control word is 6: the drive is without power. If the drive
refuses the mode, it stays without power and <code>abortCode</code> says why. Where the process data
of the drive contain 0x6060, connect <code>modeOfOperation</code> to it, because the next cycle would
overwrite what the SDO has set.
</p>
</html>"),
    Icon(graphics = {Text(extent = {{-90, -50}, {90, -90}}, textString = "%mode")}));
end StartUp;
