within EtherCAT.Drives;
block CiA402 "State machine and conversions of a drive with the device profile CiA 402"
  extends EtherCAT.Interfaces.DriveParameters;

  parameter String slaveName = ""
    "Name of the drive in the configuration of ecatd; if empty, its position below";
  parameter Integer position(min = 0) = 0 "Position of the drive on the bus, 0 first"
    annotation (Dialog(enable = slaveName == ""));
  parameter Integer axis(min = 1, max = 8) = 1
    "Axis of the drive: the indices of its objects are greater by 0x800*(axis - 1) than those named here"
    annotation (Dialog(group = "Process data"));
  parameter Boolean modeInProcessData = true
    "= true, if modeOfOperation is connected to 0x6060; = false: the mode is written by SDO"
    annotation (choices(checkBox = true), Dialog(group = "Process data"));
  parameter Boolean useModeDisplay = true "= true, if the drive has modeOfOperationDisplay in its process data"
    annotation (Evaluate = true, HideResult = true, choices(checkBox = true), Dialog(group = "Process data"));
  parameter Boolean usePosition = true "= true, if the drive has positionActualValue in its process data"
    annotation (Evaluate = true, HideResult = true, choices(checkBox = true), Dialog(group = "Process data"));
  parameter Boolean useVelocity = true "= true, if the drive has velocityActualValue in its process data"
    annotation (Evaluate = true, HideResult = true, choices(checkBox = true), Dialog(group = "Process data"));
  parameter Boolean useTorque = true "= true, if the drive has torqueActualValue in its process data"
    annotation (Evaluate = true, HideResult = true, choices(checkBox = true), Dialog(group = "Process data"));
  parameter Boolean useCurrent = true "= true, if the drive has currentActualValue in its process data"
    annotation (Evaluate = true, HideResult = true, choices(checkBox = true), Dialog(group = "Process data"));

  Modelica.Blocks.Interfaces.BooleanInput enable
    "= true, if the drive shall be in operation"
    annotation (Placement(transformation(extent = {{-324, 108}, {-300, 132}})));
  Modelica.Blocks.Interfaces.BooleanInput quickStop
    if useQuickStop
    "= true, if the drive shall stop quickly"
    annotation (Placement(transformation(extent = {{-324, 78}, {-300, 102}})));
  Modelica.Blocks.Interfaces.BooleanInput faultReset
    if useFaultReset
    "A rising edge resets a fault"
    annotation (Placement(transformation(extent = {{-324, 48}, {-300, 72}})));
  Modelica.Blocks.Interfaces.BooleanInput home
    if useHoming
    "= true, if the drive shall home; afterwards it follows its reference again"
    annotation (Placement(transformation(extent = {{-324, -72}, {-300, -48}})));
  Modelica.Blocks.Interfaces.RealInput phi_ref(quantity = "Angle", unit = "rad", displayUnit = "deg")
    if positionMode
    "Reference angle of the output"
    annotation (Placement(transformation(extent = {{-324, 18}, {-300, 42}})));
  Modelica.Blocks.Interfaces.RealInput w_ref(quantity = "AngularVelocity", unit = "rad/s")
    if velocityMode
    "Reference speed of the output"
    annotation (Placement(transformation(extent = {{-324, -12}, {-300, 12}})));
  Modelica.Blocks.Interfaces.RealInput tau_ref(quantity = "Torque", unit = "N.m")
    if torqueMode
    "Reference torque at the output"
    annotation (Placement(transformation(extent = {{-324, -42}, {-300, -18}})));
  Modelica.Blocks.Interfaces.RealOutput phi(quantity = "Angle", unit = "rad", displayUnit = "deg", start = 0, fixed = true)
    "Angle of the output"
    annotation (Placement(transformation(extent = {{300, 110}, {320, 130}})));
  Modelica.Blocks.Interfaces.RealOutput w(quantity = "AngularVelocity", unit = "rad/s", start = 0, fixed = true)
    "Speed of the output"
    annotation (Placement(transformation(extent = {{300, 80}, {320, 100}})));
  Modelica.Blocks.Interfaces.RealOutput tau(quantity = "Torque", unit = "N.m", start = 0, fixed = true)
    "Torque at the output"
    annotation (Placement(transformation(extent = {{300, 50}, {320, 70}})));
  Modelica.Blocks.Interfaces.RealOutput i(quantity = "ElectricCurrent", unit = "A", start = 0, fixed = true)
    "Current of the motor"
    annotation (Placement(transformation(extent = {{300, 20}, {320, 40}})));
  Modelica.Blocks.Interfaces.BooleanOutput enabled(start = false, fixed = true)
    "= true, if the drive follows its reference"
    annotation (Placement(transformation(extent = {{300, -10}, {320, 10}})));
  Modelica.Blocks.Interfaces.BooleanOutput fault
    "= true, if the drive has a fault, or reacts to one"
    annotation (Placement(transformation(extent = {{300, -40}, {320, -20}})));
  Modelica.Blocks.Interfaces.BooleanOutput homed
    "= true, if the drive was homed by this block"
    annotation (Placement(transformation(extent = {{300, -70}, {320, -50}})));
  Modelica.Blocks.Interfaces.IntegerOutput modeOfOperation(start = 0, fixed = true)
    "Mode of operation 0x6060"
    annotation (Placement(transformation(extent = {{-10, -10}, {10, 10}}, origin = {-280, -150}, rotation = 270)));
  Modelica.Blocks.Interfaces.IntegerOutput controlWord(start = 0, fixed = true)
    "Control word 0x6040"
    annotation (Placement(transformation(extent = {{-10, -10}, {10, 10}}, origin = {-258, -150}, rotation = 270)));
  Modelica.Blocks.Interfaces.IntegerOutput maxTorque(start = 0, fixed = true)
    "Max torque 0x6072"
    annotation (Placement(transformation(extent = {{-10, -10}, {10, 10}}, origin = {-236, -150}, rotation = 270)));
  Modelica.Blocks.Interfaces.IntegerOutput targetTorque(start = 0, fixed = true)
    "Target torque 0x6071"
    annotation (Placement(transformation(extent = {{-10, -10}, {10, 10}}, origin = {-214, -150}, rotation = 270)));
  Modelica.Blocks.Interfaces.IntegerOutput targetVelocity(start = 0, fixed = true)
    "Target velocity 0x60FF"
    annotation (Placement(transformation(extent = {{-10, -10}, {10, 10}}, origin = {-192, -150}, rotation = 270)));
  Modelica.Blocks.Interfaces.IntegerOutput targetPosition(start = 0, fixed = true)
    "Target position 0x607A"
    annotation (Placement(transformation(extent = {{-10, -10}, {10, 10}}, origin = {-170, -150}, rotation = 270)));
  Modelica.Blocks.Interfaces.BooleanInput valid
    "= true, if the values of the slave are valid: its connector of this name"
    annotation (Placement(transformation(extent = {{-10, -10}, {10, 10}}, origin = {148, -150}, rotation = 90)));
  Modelica.Blocks.Interfaces.IntegerInput positionActualValue
    if usePosition
    "Position actual value 0x6064"
    annotation (Placement(transformation(extent = {{-10, -10}, {10, 10}}, origin = {170, -150}, rotation = 90)));
  Modelica.Blocks.Interfaces.IntegerInput torqueActualValue
    if useTorque
    "Torque actual value 0x6077"
    annotation (Placement(transformation(extent = {{-10, -10}, {10, 10}}, origin = {192, -150}, rotation = 90)));
  Modelica.Blocks.Interfaces.IntegerInput statusWord
    "Status word 0x6041"
    annotation (Placement(transformation(extent = {{-10, -10}, {10, 10}}, origin = {214, -150}, rotation = 90)));
  Modelica.Blocks.Interfaces.IntegerInput modeOfOperationDisplay
    if useModeDisplay
    "Mode of operation display 0x6061"
    annotation (Placement(transformation(extent = {{-10, -10}, {10, 10}}, origin = {236, -150}, rotation = 90)));
  Modelica.Blocks.Interfaces.IntegerInput velocityActualValue
    if useVelocity
    "Velocity actual value 0x606C"
    annotation (Placement(transformation(extent = {{-10, -10}, {10, 10}}, origin = {258, -150}, rotation = 90)));
  Modelica.Blocks.Interfaces.IntegerInput currentActualValue
    if useCurrent
    "Current actual value 0x6078"
    annotation (Placement(transformation(extent = {{-10, -10}, {10, 10}}, origin = {280, -150}, rotation = 90)));

  EtherCAT.Types.DriveState state(
    start = EtherCAT.Types.DriveState.NotReadyToSwitchOn,
    fixed = true) "State of the drive";
  Boolean reached(start = false, fixed = true) "= true, if the drive has reached its reference";
  EtherCAT.Types.DriveHoming homing(
    start = EtherCAT.Types.DriveHoming.NotHomed,
    fixed = true) "How homing goes";
  Integer startUpState(start = 0, fixed = true)
    "Start-up list; 0: not begun yet, 1: busy, 2: done, 3: refused";
protected
  outer EtherCAT.EtherCATMaster etherCATMaster "Connection to the bus";
  Boolean sampled = etherCATMaster.sampled[EtherCAT.Functions.domainIndex(
    domainID, size(etherCATMaster.sampled, 1))] "True at the sample instants of the domain";
  parameter EtherCAT.Objects.Drive drive = EtherCAT.Objects.Drive(
    etherCATMaster.master, position, slaveName, axis, mode, reference, restart,
    (if useModeDisplay then 1 else 0) + (if usePosition then 2 else 0) + (if useVelocity then 4 else 0) + (if useTorque then 8 else 0) + (if useCurrent then 16 else 0),
    if modeInProcessData then 0 else 24672 + 2048*(axis - 1), if useHoming then homingMethod else 0, encoderResolution, gearRatio,
    velocityScale, ratedTorque, ratedCurrent, tau_max, approachSpeed, standstillSpeed, maxDropout, startUp,
    getInstanceName()) "State machine";
  Modelica.Blocks.Interfaces.RealInput reference_internal
    "Needed to connect to conditional connectors";
  Modelica.Blocks.Interfaces.BooleanInput quickStop_internal
    "Needed to connect to a conditional connector";
  Modelica.Blocks.Interfaces.BooleanInput faultReset_internal
    "Needed to connect to a conditional connector";
  Modelica.Blocks.Interfaces.BooleanInput home_internal
    "Needed to connect to a conditional connector";
  Modelica.Blocks.Interfaces.IntegerInput modeOfOperationDisplay_internal
    "Needed to connect to a conditional connector";
  Modelica.Blocks.Interfaces.IntegerInput positionActualValue_internal
    "Needed to connect to a conditional connector";
  Modelica.Blocks.Interfaces.IntegerInput velocityActualValue_internal
    "Needed to connect to a conditional connector";
  Modelica.Blocks.Interfaces.IntegerInput torqueActualValue_internal
    "Needed to connect to a conditional connector";
  Modelica.Blocks.Interfaces.IntegerInput currentActualValue_internal
    "Needed to connect to a conditional connector";
equation
  connect(phi_ref, reference_internal);
  connect(w_ref, reference_internal);
  connect(tau_ref, reference_internal);
  connect(quickStop, quickStop_internal);
  connect(faultReset, faultReset_internal);
  connect(home, home_internal);
  connect(modeOfOperationDisplay, modeOfOperationDisplay_internal);
  connect(positionActualValue, positionActualValue_internal);
  connect(velocityActualValue, velocityActualValue_internal);
  connect(torqueActualValue, torqueActualValue_internal);
  connect(currentActualValue, currentActualValue_internal);
  if not useQuickStop then
    quickStop_internal = false;
  end if;
  if not useFaultReset then
    faultReset_internal = enable;
  end if;
  if not useHoming then
    home_internal = false;
  end if;
  if not useModeDisplay then
    modeOfOperationDisplay_internal = 0;
  end if;
  if not usePosition then
    positionActualValue_internal = 0;
  end if;
  if not useVelocity then
    velocityActualValue_internal = 0;
  end if;
  if not useTorque then
    torqueActualValue_internal = 0;
  end if;
  if not useCurrent then
    currentActualValue_internal = 0;
  end if;

  // Two when-equations for the drive: in one, a controller between them would close a loop.
  when sampled then
    (state, phi, w, tau, i, enabled) = EtherCAT.Functions.driveMeasure(
      drive, time, etherCATMaster.cycle, valid, statusWord, modeOfOperationDisplay_internal,
      positionActualValue_internal, velocityActualValue_internal, torqueActualValue_internal,
      currentActualValue_internal);
  end when;
  when sampled then
    (controlWord, modeOfOperation, targetPosition, targetVelocity, targetTorque, maxTorque, startUpState, homing, reached) =
      EtherCAT.Functions.driveCommand(
        drive, time, state, enable, quickStop_internal, faultReset_internal, home_internal, reference_internal);
  end when;
  fault = state == EtherCAT.Types.DriveState.Fault or
    state == EtherCAT.Types.DriveState.FaultReactionActive;
  homed = homing == EtherCAT.Types.DriveHoming.Homed;

  annotation (
    defaultComponentName = "cia402",
    Documentation(info = "<html>
<p>
The block connects the process data of a drive (below) with a model (left and right). It leads the drive
through the states of CiA&nbsp;402 (IEC&nbsp;61800-7-201), and converts between increments, 1/1000 of the
rated values and SI units at the output of the gear.
</p>
<h4>Reference</h4>
<p>
The parameter <code>mode</code> selects the connector of the reference: <code>phi_ref</code> in position modes,
<code>w_ref</code> in velocity modes, <code>tau_ref</code> in torque modes. The block changes the mode only
while the drive is not in operation, and enables the drive only when the drive shows this mode.
</p>
<h4>Enabling without a jump</h4>
<p>
Until <code>enabled</code> becomes true, the targets follow the actual values (the target torque is zero).
After that, a position reference counts from the actual position (<code>Relative</code>), or the target
approaches it with <code>approachSpeed</code> (<code>Absolute</code>): see
<a href=\"modelica://EtherCAT.Types.DriveReference\">DriveReference</a>. After a quick stop, a fault, a
loss of the bus, or when <code>enable</code> was false, the targets follow the actual values again, and
the next enabling is like the first one.
</p>
<h4>Restart</h4>
<p>
A speed or a torque reference acts at full size as soon as the drive is enabled. So after a loss (no valid data for
<code>maxDropout</code>, a lease that the model has missed, or another daemon), after a fault or a quick stop, and when the
drive has left its operation by itself, the drive stays off until <code>enable</code> is switched off and on:
<code>restart = Edge</code>, the default. A message says so once. With <code>restart = Automatic</code> the drive is enabled
again as soon as that is possible. When the drive appears for the first time, is switched off and has no fault, an
<code>enable</code> that is true already is enough. <a href=\"modelica://EtherCAT.Types.DriveRestart\">DriveRestart</a> has
a table of all cases.
</p>
<h4>Parameters and the drive</h4>
<p>
Whenever the drive appears, the block reads its objects 0x608F, 0x6076 and 0x6075. A message names each of
<code>encoderResolution</code>, <code>ratedTorque</code> and <code>ratedCurrent</code> that differs from them. Objects that the
drive does not have, or that are 0, are passed over.
</p>
<h4>States</h4>
<table border=\"1\" cellspacing=\"0\" cellpadding=\"2\">
<tr><th>state of the drive</th><th>enable is true</th><th>enable is false</th></tr>
<tr><td>Not ready to switch on</td><td>0 (disable voltage)</td><td>0</td></tr>
<tr><td>Switch on disabled</td><td>6 (shutdown)</td><td>6</td></tr>
<tr><td>Ready to switch on</td><td>7 (switch on)</td><td>6</td></tr>
<tr><td>Switched on</td><td>15 (enable operation)</td><td>6</td></tr>
<tr><td>Operation enabled</td><td>15</td><td>7 (disable operation: the drive brakes as 0x605C says)</td></tr>
<tr><td>Quick stop active</td><td>2 until the motor stands still, then 0</td><td>the same</td></tr>
<tr><td>Fault reaction active</td><td>0</td><td>0</td></tr>
<tr><td>Fault</td><td>128 (fault reset) after a rising edge, else 0</td><td>0</td></tr>
</table>
<p>
While <code>quickStop</code> is true, the control word is 2. After a short request it stays 2 until the drive
leaves its operation. The drive stops as its object 0x605A says; <code>restart</code> decides when it is
enabled again. A rising edge of
<code>faultReset</code> resets a fault; <code>faultReset</code> must stay true until the drive has reset it.
Without that connector a rising edge of <code>enable</code> resets a fault, even if the edge came before the
fault was seen. One edge resets one fault. In profile position, the bits 4, 5 (change immediately) and 12 hand
each change of the target over.
</p>
<h4>Homing</h4>
<p>
With <code>useHoming</code>, a true <code>home</code> takes the drive, once it is enabled and stands still, into homing mode
(0x6060 = 6), which needs <code>modeInProcessData</code>. The drive moves as its method says: object 0x6098, which
<code>homingMethod</code> sets, with the speeds 0x6099. Then <code>homed</code> is true, and when <code>home</code> becomes false
the drive follows its reference again, without a jump. <code>homed</code> becomes false when the drive is lost, since it may
have lost its position. If the drive does not find its reference, <code>homing</code> is <code>Failed</code>.
</p>
<h4>Validity and start-up list</h4>
<p>
While <code>valid</code> is false, the outputs keep their values. After <code>maxDropout</code> the control
word is 0 and the state is <code>NotReadyToSwitchOn</code>. Whenever the drive appears (again), the objects of
<code>startUp</code> are written one after the other, and the drive is not enabled before all of them are
written. If the drive refuses an object, it stays off: <code>startUpState</code> is 3, and a message names the
object and the reason. The block writes the list again when <code>enable</code> is switched off and on. A row
of <code>startUp</code> is <code>{index, subindex, Integer(DataType), value}</code>; 0x605A is
<code>24666</code>.
</p>
<h4>Process data</h4>
<p>
Connect the entries that the drive has, and set <code>useTorque</code> and similar parameters to false for
entries that it does not have. Without velocity, <code>w</code> is the difference of positions per time. Torque
and current replace each other. Positions count on when the 32 bits of the drive overflow. <code>phi</code> is
zero where the position of the drive is zero. A drive with several axes has one block of this class for each
axis, with the number <code>axis</code>; all of them are connected to the one block of the slave. The gear has
no losses: <code>tau</code> is the torque of the motor times <code>gearRatio</code>.
</p>
<p>
You may put a controller between the outputs and the reference: the measured values do not depend on the
reference, so there is no algebraic loop. An integrator in the controller counts up while the drive does not
follow, and then the reference jumps when the drive is enabled. Therefore hold or reset the integrator until
<code>enabled</code> is true.
</p>
<p>
<strong>Before you simulate with real hardware</strong>, set <code>encoderResolution</code>,
<code>gearRatio</code>, <code>ratedTorque</code> and <code>tau_max</code> to the data of the motor: a wrong
resolution means a wrong speed. No output of a model is an emergency stop.
</p>
</html>"),
    Icon(
      coordinateSystem(preserveAspectRatio = true, extent = {{-300, -140}, {300, 140}}),
      graphics = {
        Rectangle(extent = {{-300, 140}, {300, -140}}, lineColor = {64, 64, 64}, fillColor = {240, 248, 248}, fillPattern = FillPattern.Solid, radius = 10),
        Ellipse(extent = {{-90, 100}, {-30, 40}}, lineColor = {64, 64, 64}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid),
        Ellipse(extent = {{30, 100}, {90, 40}}, lineColor = {64, 64, 64}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid),
        Ellipse(extent = {{-30, 10}, {30, -50}}, lineColor = {64, 64, 64}, fillColor = {95, 158, 160}, fillPattern = FillPattern.Solid),
        Line(points = {{-30, 70}, {30, 70}}, color = {64, 64, 64}, arrow = {Arrow.None, Arrow.Filled}),
        Line(points = {{52, 41}, {22, 2}}, color = {64, 64, 64}, arrow = {Arrow.None, Arrow.Filled}),
        Line(points = {{-22, 2}, {-52, 41}}, color = {64, 64, 64}, arrow = {Arrow.None, Arrow.Filled}),
        Text(extent = {{-110, -60}, {110, -95}}, textString = "CiA 402", textStyle = {TextStyle.Bold}),
        Text(extent = {{-130, -100}, {130, -130}}, textString = "%mode"),
        Text(extent = {{-294, 131}, {-150, 109}}, textString = "enable", horizontalAlignment = TextAlignment.Left),
        Text(extent = {{-294, 101}, {-150, 79}}, textString = "quickStop", horizontalAlignment = TextAlignment.Left, visible = useQuickStop),
        Text(extent = {{-294, 71}, {-150, 49}}, textString = "faultReset", horizontalAlignment = TextAlignment.Left, visible = useFaultReset),
        Text(extent = {{-294, 41}, {-150, 19}}, textString = "phi_ref", horizontalAlignment = TextAlignment.Left, visible = positionMode),
        Text(extent = {{-294, 11}, {-150, -11}}, textString = "w_ref", horizontalAlignment = TextAlignment.Left, visible = velocityMode),
        Text(extent = {{-294, -19}, {-150, -41}}, textString = "tau_ref", horizontalAlignment = TextAlignment.Left, visible = torqueMode),
        Text(extent = {{-294, -49}, {-150, -71}}, textString = "home", horizontalAlignment = TextAlignment.Left, visible = useHoming),
        Text(extent = {{150, -49}, {294, -71}}, textString = "homed", horizontalAlignment = TextAlignment.Right),
        Text(extent = {{150, 131}, {294, 109}}, textString = "phi", horizontalAlignment = TextAlignment.Right),
        Text(extent = {{150, 101}, {294, 79}}, textString = "w", horizontalAlignment = TextAlignment.Right),
        Text(extent = {{150, 71}, {294, 49}}, textString = "tau", horizontalAlignment = TextAlignment.Right),
        Text(extent = {{150, 41}, {294, 19}}, textString = "i", horizontalAlignment = TextAlignment.Right),
        Text(extent = {{150, 11}, {294, -11}}, textString = "enabled", horizontalAlignment = TextAlignment.Right),
        Text(extent = {{150, -19}, {294, -41}}, textString = "fault", horizontalAlignment = TextAlignment.Right),
        Text(extent = {{-31, 10}, {31, -10}}, origin = {-280, -104}, rotation = 90, textString = "mode", horizontalAlignment = TextAlignment.Left),
        Text(extent = {{-31, 10}, {31, -10}}, origin = {-258, -104}, rotation = 90, textString = "control", horizontalAlignment = TextAlignment.Left),
        Text(extent = {{-31, 10}, {31, -10}}, origin = {-236, -104}, rotation = 90, textString = "max tau", horizontalAlignment = TextAlignment.Left),
        Text(extent = {{-31, 10}, {31, -10}}, origin = {-214, -104}, rotation = 90, textString = "torque", horizontalAlignment = TextAlignment.Left),
        Text(extent = {{-31, 10}, {31, -10}}, origin = {-192, -104}, rotation = 90, textString = "velocity", horizontalAlignment = TextAlignment.Left),
        Text(extent = {{-31, 10}, {31, -10}}, origin = {-170, -104}, rotation = 90, textString = "position", horizontalAlignment = TextAlignment.Left),
        Text(extent = {{-31, 10}, {31, -10}}, origin = {148, -104}, rotation = 90, textString = "valid", horizontalAlignment = TextAlignment.Left),
        Text(extent = {{-31, 10}, {31, -10}}, origin = {170, -104}, rotation = 90, textString = "position", horizontalAlignment = TextAlignment.Left, visible = usePosition),
        Text(extent = {{-31, 10}, {31, -10}}, origin = {192, -104}, rotation = 90, textString = "torque", horizontalAlignment = TextAlignment.Left, visible = useTorque),
        Text(extent = {{-31, 10}, {31, -10}}, origin = {214, -104}, rotation = 90, textString = "status", horizontalAlignment = TextAlignment.Left),
        Text(extent = {{-31, 10}, {31, -10}}, origin = {236, -104}, rotation = 90, textString = "mode", horizontalAlignment = TextAlignment.Left, visible = useModeDisplay),
        Text(extent = {{-31, 10}, {31, -10}}, origin = {258, -104}, rotation = 90, textString = "velocity", horizontalAlignment = TextAlignment.Left, visible = useVelocity),
        Text(extent = {{-31, 10}, {31, -10}}, origin = {280, -104}, rotation = 90, textString = "current", horizontalAlignment = TextAlignment.Left, visible = useCurrent),
        Text(extent = {{-300, 190}, {300, 150}}, textColor = {0, 0, 255}, textString = "%name")}));
end CiA402;
