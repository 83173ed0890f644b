within ;
model CanopenDrive "Figure 9 of the paper with a CANopen drive behind an EL6751"
  extends Modelica.Icons.Example;
  inner EtherCAT.EtherCATMaster etherCATMaster(waitForBus = true)
    "Connection to the bus, which paces the model";
  CanPlant.CanDrives can "The terminal, with the PDOs of the drive";
  EtherCAT.Drives.CiA402 drive(
    slaveName = "can-drives",
    mode = EtherCAT.Types.DriveMode.CyclicVelocity,
    encoderResolution = 65536,
    ratedTorque = 0.4,
    ratedCurrent = 5,
    useCurrent = false) "State machine of the drive, in SI units";
  EtherCAT.Sources.PointToPoint reference(
    distance = 471.24, maxSpeed = 62.832, maxAcceleration = 125.66, startTime = 1)
    "Reference speed";
  Modelica.Blocks.Sources.BooleanConstant enable(k = true) "The drive shall be in operation";
  EtherCAT.CAN.SendFrame nmt(slaveName = "can-drives", length = 2, period = 0.5)
    "Starts node 5, also after it was away";
  EtherCAT.CAN.SendFrame sync(
    slaveName = "can-drives",
    identifier = 128,
    length = 0,
    transmission = EtherCAT.Types.CANTransmission.EachSample) "The drive answers with its PDOs";
  output Real w_ref(unit = "rad/s") = reference.y "Reference speed";
  output Real w_m(unit = "rad/s") = drive.w "Measured speed";
  output Real i_m(unit = "A") = drive.i "Measured current";
equation
  nmt.u = {1, 5, 0, 0, 0, 0, 0, 0};
  sync.u = fill(0, 8);
  connect(enable.y, drive.enable);
  connect(reference.y, drive.w_ref);
  drive.valid = can.node5TPDO2Valid and can.node5TPDO3Valid;
  connect(can.node5TPDO2Statusword, drive.statusWord);
  connect(can.node5TPDO1ModesOfOperationDisplay, drive.modeOfOperationDisplay);
  connect(can.node5TPDO3PositionActualValue, drive.positionActualValue);
  connect(can.node5TPDO3VelocityActualValue, drive.velocityActualValue);
  connect(can.node5TPDO4TorqueActualValue, drive.torqueActualValue);
  connect(drive.controlWord, can.node5RPDO1Controlword);
  connect(drive.controlWord, can.node5RPDO2Controlword);
  connect(drive.controlWord, can.node5RPDO3Controlword);
  connect(drive.controlWord, can.node5RPDO4Controlword);
  connect(drive.modeOfOperation, can.node5RPDO1ModesOfOperation);
  connect(drive.targetPosition, can.node5RPDO2TargetPosition);
  connect(drive.targetVelocity, can.node5RPDO3TargetVelocity);
  connect(drive.targetTorque, can.node5RPDO4TargetTorque);

  annotation (experiment(StopTime = 10, Interval = 0.001));
end CanopenDrive;
