within ;
model WheelOverCAN "Move a CANopen drive behind a CAN terminal over a distance and back to rest"
  extends Modelica.Icons.Example;

  parameter Integer resolution = 65536 "Increments of the encoder in one revolution of the motor";
  parameter Modelica.Units.SI.Current ratedCurrent = 5 "Current at the rated torque";

  inner EtherCAT.EtherCATMaster etherCATMaster(
    bus = "ecat0",
    sampleTime = {0.001},
    waitForBus = true)
    "Connection to the bus, which paces the model"
    annotation (Placement(transformation(extent = {{-90, 60}, {-70, 80}})));
  TrollPlant.Can can(
    node5RPDO2Transmission = EtherCAT.Types.CANTransmission.OnTrigger,
    node5RPDO3Transmission = EtherCAT.Types.CANTransmission.EachSample,
    node5RPDO4Transmission = EtherCAT.Types.CANTransmission.OnTrigger)
    "PDOs of the drive, which is node 5. RPDO 2 and 4 are for other modes, and never sent";
  EtherCAT.CAN.SendFrame startNode(slaveName = "can", identifier = 0, length = 2)
    "NMT: node 5 goes to OPERATIONAL, once at the beginning"
    annotation (Placement(transformation(extent = {{-10, -60}, {10, -40}})));
  EtherCAT.CAN.SendFrame sync(
    slaveName = "can",
    identifier = 128,
    length = 0,
    transmission = EtherCAT.Types.CANTransmission.EachSample)
    "SYNC: the drive answers with TPDO 2, 3 and 4"
    annotation (Placement(transformation(extent = {{40, -60}, {60, -40}})));
  EtherCAT.Sources.PointToPoint reference(
    distance = 471.24,
    maxSpeed = 62.832,
    maxAcceleration = 125.66,
    startTime = 1)
    "Reference speed"
    annotation (Placement(transformation(extent = {{-90, -40}, {-70, -20}})));
  EtherCAT.Conversions.RealToInteger increments(k = resolution / (2 * Modelica.Constants.pi))
    "From rad/s to increments per second"
    annotation (Placement(transformation(extent = {{-50, -40}, {-30, -20}})));

  Integer control "Control word, which leads the drive to \"Operation enabled\"";
  Real w_ref(unit = "rad/s") = reference.y "Reference speed";
  Real w_m(unit = "rad/s") = can.node5TPDO3VelocityActualValue * 2 * Modelica.Constants.pi / resolution
    "Measured speed";
  Real i_m(unit = "A") = can.node5TPDO4TorqueActualValue * ratedCurrent / 1000
    "Measured current; the drive tells it in thousandths of the rated value";
  Real age_m(unit = "s") = can.node5TPDO3Age "Age of the measured speed";

protected
  function command "Control word that leads from a state towards \"Operation enabled\" (CiA 402)"
    extends Modelica.Icons.Function;
    input Integer status "Status word";
    output Integer control "Control word";
  algorithm
    control :=
      if EtherCAT.Functions.bit(status, 3) then 128 // fault reset
      elseif EtherCAT.Functions.bit(status, 6) then 6 // shutdown
      elseif EtherCAT.Functions.bit(status, 1) then 15 // enable operation
      else 7; // switch on
  end command;
equation
  connect(reference.y, increments.u)
    annotation (Line(points = {{-69, -30}, {-52, -30}}, color = {0, 0, 127}));
  startNode.u = {1, 5, 0, 0, 0, 0, 0, 0};
  sync.u = fill(0, 8);
  control = if can.node5TPDO4Valid then command(can.node5TPDO4Statusword) else 0;
  can.node5RPDO1Controlword = control;
  can.node5RPDO1ModesOfOperation = 9; // cyclic synchronous velocity
  can.node5RPDO2Controlword = control;
  can.node5RPDO2TargetPosition = 0;
  can.node5RPDO3Controlword = control;
  can.node5RPDO3TargetVelocity = increments.y;
  can.node5RPDO4Controlword = control;
  can.node5RPDO4TargetTorque = 0;

  annotation (
    experiment(StopTime = 10, Interval = 0.001),
    Documentation(info = "<html>
<p>
The experiment of Figure 9 of the paper on the DLR EtherCAT library, with a CANopen drive: node 5 on the CAN bus behind
the terminal <code>can</code> of the simulated rig <code>troll-can</code>. Plot w_ref, w_m and i_m.
</p>
<p>
The drive is in the mode cyclic synchronous velocity. Its PDOs are mapped as its EDS file says: the control word and the
speed go to it at every sample, and it tells its speed and torque at every SYNC. New values come in batches, as the
terminal hands them over; age_m tells how old the speed is. When the model ends, in order or not, ecatd sends the safe
frames of <code>[[slave.can.safe]]</code>, which stop the drive.
</p>
</html>"));
end WheelOverCAN;
