within EtherCAT.Interfaces;
partial block PartialDrive "Base of drives: SI units outside, state machine and conversions inside"
  extends EtherCAT.Interfaces.DriveParameters;
  extends EtherCAT.Icons.Drive;

  Modelica.Blocks.Interfaces.BooleanInput enable
    "= true, if the drive shall be in operation"
    annotation (Placement(
      transformation(extent = {{-215, 93}, {-201, 107}}),
      iconTransformation(extent = {{-124, 48}, {-100, 72}})));
  Modelica.Blocks.Interfaces.BooleanInput quickStop
    if useQuickStop
    "= true, if the drive shall stop quickly"
    annotation (Placement(
      transformation(extent = {{-215, 78}, {-201, 92}}),
      iconTransformation(extent = {{-124, 20}, {-100, 44}})));
  Modelica.Blocks.Interfaces.BooleanInput faultReset
    if useFaultReset
    "A rising edge resets a fault"
    annotation (Placement(
      transformation(extent = {{-215, 63}, {-201, 77}}),
      iconTransformation(extent = {{-124, -8}, {-100, 16}})));
  Modelica.Blocks.Interfaces.BooleanInput home
    if useHoming
    "= true, if the drive shall home; afterwards it follows its reference again"
    annotation (Placement(
      transformation(extent = {{-215, 3}, {-201, 17}}),
      iconTransformation(extent = {{-124, 76}, {-100, 100}})));
  Modelica.Blocks.Interfaces.RealInput phi_ref(quantity = "Angle", unit = "rad", displayUnit = "deg")
    if positionMode
    "Reference angle of the output"
    annotation (Placement(
      transformation(extent = {{-215, 48}, {-201, 62}}),
      iconTransformation(extent = {{-124, -36}, {-100, -12}})));
  Modelica.Blocks.Interfaces.RealInput w_ref(quantity = "AngularVelocity", unit = "rad/s")
    if velocityMode
    "Reference speed of the output"
    annotation (Placement(
      transformation(extent = {{-215, 33}, {-201, 47}}),
      iconTransformation(extent = {{-124, -64}, {-100, -40}})));
  Modelica.Blocks.Interfaces.RealInput tau_ref(quantity = "Torque", unit = "N.m")
    if torqueMode
    "Reference torque at the output"
    annotation (Placement(
      transformation(extent = {{-215, 18}, {-201, 32}}),
      iconTransformation(extent = {{-124, -92}, {-100, -68}})));
  Modelica.Blocks.Interfaces.RealOutput phi(quantity = "Angle", unit = "rad", displayUnit = "deg")
    "Angle of the output"
    annotation (Placement(
      transformation(extent = {{201, 93}, {215, 107}}),
      iconTransformation(extent = {{100, 50}, {120, 70}})));
  Modelica.Blocks.Interfaces.RealOutput w(quantity = "AngularVelocity", unit = "rad/s")
    "Speed of the output"
    annotation (Placement(
      transformation(extent = {{201, 78}, {215, 92}}),
      iconTransformation(extent = {{100, 22}, {120, 42}})));
  Modelica.Blocks.Interfaces.RealOutput tau(quantity = "Torque", unit = "N.m")
    "Torque at the output"
    annotation (Placement(
      transformation(extent = {{201, 63}, {215, 77}}),
      iconTransformation(extent = {{100, -6}, {120, 14}})));
  Modelica.Blocks.Interfaces.RealOutput i(quantity = "ElectricCurrent", unit = "A")
    "Current of the motor"
    annotation (Placement(
      transformation(extent = {{201, 48}, {215, 62}}),
      iconTransformation(extent = {{100, -34}, {120, -14}})));
  Modelica.Blocks.Interfaces.BooleanOutput enabled
    "= true, if the drive follows its reference"
    annotation (Placement(
      transformation(extent = {{201, 33}, {215, 47}}),
      iconTransformation(extent = {{100, -62}, {120, -42}})));
  Modelica.Blocks.Interfaces.BooleanOutput fault
    "= true, if the drive has a fault, or reacts to one"
    annotation (Placement(
      transformation(extent = {{201, 18}, {215, 32}}),
      iconTransformation(extent = {{100, -90}, {120, -70}})));
  Modelica.Blocks.Interfaces.BooleanOutput homed
    if useHoming
    "= true, if the drive was homed by this block"
    annotation (Placement(
      transformation(extent = {{201, 3}, {215, 17}}),
      iconTransformation(extent = {{100, 78}, {120, 98}})));
  EtherCAT.Drives.CiA402 cia402(
    final mode = mode,
    final reference = reference,
    final restart = restart,
    final approachSpeed = approachSpeed,
    final useQuickStop = useQuickStop,
    final useFaultReset = useFaultReset,
    final useHoming = useHoming,
    final homingMethod = homingMethod,
    final encoderResolution = encoderResolution,
    final gearRatio = gearRatio,
    final velocityScale = velocityScale,
    final ratedTorque = ratedTorque,
    final ratedCurrent = ratedCurrent,
    final tau_max = tau_max,
    final startUp = startUp,
    final standstillSpeed = standstillSpeed,
    final maxDropout = maxDropout,
    final domainID = domainID)
    "State machine and conversions"
    annotation (Placement(transformation(extent = {{-150, -30}, {150, 110}})));
  EtherCAT.Types.DriveState state = cia402.state "State of the drive";
  EtherCAT.Types.DriveHoming homing = cia402.homing "How homing goes";
  Boolean reached = cia402.reached "= true, if the drive has reached its reference";
equation
  connect(enable, cia402.enable)
    annotation (Line(points = {{-208, 100}, {-156, 100}}, color = {255, 0, 255}));
  connect(quickStop, cia402.quickStop)
    annotation (Line(points = {{-208, 85}, {-156, 85}}, color = {255, 0, 255}));
  connect(faultReset, cia402.faultReset)
    annotation (Line(points = {{-208, 70}, {-156, 70}}, color = {255, 0, 255}));
  connect(phi_ref, cia402.phi_ref)
    annotation (Line(points = {{-208, 55}, {-156, 55}}, color = {0, 0, 127}));
  connect(w_ref, cia402.w_ref)
    annotation (Line(points = {{-208, 40}, {-156, 40}}, color = {0, 0, 127}));
  connect(tau_ref, cia402.tau_ref)
    annotation (Line(points = {{-208, 25}, {-156, 25}}, color = {0, 0, 127}));
  connect(cia402.phi, phi)
    annotation (Line(points = {{155, 100}, {208, 100}}, color = {0, 0, 127}));
  connect(cia402.w, w)
    annotation (Line(points = {{155, 85}, {208, 85}}, color = {0, 0, 127}));
  connect(cia402.tau, tau)
    annotation (Line(points = {{155, 70}, {208, 70}}, color = {0, 0, 127}));
  connect(cia402.i, i)
    annotation (Line(points = {{155, 55}, {208, 55}}, color = {0, 0, 127}));
  connect(cia402.enabled, enabled)
    annotation (Line(points = {{155, 40}, {208, 40}}, color = {255, 0, 255}));
  connect(cia402.fault, fault)
    annotation (Line(points = {{155, 25}, {208, 25}}, color = {255, 0, 255}));
  connect(home, cia402.home)
    annotation (Line(points = {{-208, 10}, {-156, 10}}, color = {255, 0, 255}));
  connect(cia402.homed, homed)
    annotation (Line(points = {{155, 10}, {208, 10}}, color = {255, 0, 255}));

  annotation (
    Icon(graphics = {
      Text(extent = {{-96, 97}, {-20, 79}}, textString = "home", horizontalAlignment = TextAlignment.Left, visible = useHoming),
      Text(extent = {{20, 97}, {96, 79}}, textString = "homed", horizontalAlignment = TextAlignment.Right, visible = useHoming),
      Text(extent = {{-96, 69}, {-20, 51}}, textString = "enable", horizontalAlignment = TextAlignment.Left),
      Text(extent = {{-96, 41}, {-20, 23}}, textString = "quickStop", horizontalAlignment = TextAlignment.Left, visible = useQuickStop),
      Text(extent = {{-96, 13}, {-20, -5}}, textString = "faultReset", horizontalAlignment = TextAlignment.Left, visible = useFaultReset),
      Text(extent = {{-96, -15}, {-20, -33}}, textString = "phi_ref", horizontalAlignment = TextAlignment.Left, visible = positionMode),
      Text(extent = {{-96, -43}, {-20, -61}}, textString = "w_ref", horizontalAlignment = TextAlignment.Left, visible = velocityMode),
      Text(extent = {{-96, -71}, {-20, -89}}, textString = "tau_ref", horizontalAlignment = TextAlignment.Left, visible = torqueMode),
      Text(extent = {{20, 69}, {96, 51}}, textString = "phi", horizontalAlignment = TextAlignment.Right),
      Text(extent = {{20, 41}, {96, 23}}, textString = "w", horizontalAlignment = TextAlignment.Right),
      Text(extent = {{20, 13}, {96, -5}}, textString = "tau", horizontalAlignment = TextAlignment.Right),
      Text(extent = {{20, -15}, {96, -33}}, textString = "i", horizontalAlignment = TextAlignment.Right),
      Text(extent = {{20, -43}, {96, -61}}, textString = "enabled", horizontalAlignment = TextAlignment.Right),
      Text(extent = {{20, -71}, {96, -89}}, textString = "fault", horizontalAlignment = TextAlignment.Right)}),
    Diagram(coordinateSystem(extent = {{-200, -200}, {200, 140}})),
    Documentation(info = "<html>
<p>
A drive as a model uses it. A block that extends this one adds the block of the slave, and connects it with
<code>cia402</code>. <a href=\"modelica://EtherCAT.Drives.CiA402\">CiA402</a> explains the connectors.
</p>
</html>"));
end PartialDrive;
