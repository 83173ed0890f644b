within ;
model CanModels "Blocks of EtherCAT.CAN in a model, in which each has its parameters of all kinds"
  extends Modelica.Icons.Example;
  inner EtherCAT.EtherCATMaster etherCATMaster "Connection";
  EtherCAT.CAN.ReceiveSignal speed(
    position = 7, identifier = 385, startBit = 7, bitLength = 16, bigEndian = true,
    number = EtherCAT.Types.CANNumber.Signed, scale = 0.1, unit = "rpm", timeout = 0.5) "Signal";
  EtherCAT.CAN.ReceiveFrame frame(slaveName = "canTerminal", identifier = 419361278, minLength = 2)
    "Frame";
  EtherCAT.CAN.SendSignal target(
    position = 7, identifier = 500, bitLength = 32, length = 6, unit = "rad/s",
    transmission = EtherCAT.Types.CANTransmission.Periodic, period = 0.01) "Half of a frame";
  EtherCAT.CAN.SendSignal mode(
    position = 7, identifier = 500, startBit = 32, bitLength = 8, length = 6,
    transmission = EtherCAT.Types.CANTransmission.Periodic, period = 0.01) "Its other half";
  EtherCAT.CAN.SendFrame start(
    position = 7, length = 2, transmission = EtherCAT.Types.CANTransmission.OnTrigger,
    reserve = true) "Starts all nodes";
  EtherCAT.CAN.ChannelState state(position = 7) "State of the terminal";
  Modelica.Blocks.Sources.IntegerConstant once(k = 1) "Trigger";
equation
  target.u = speed.y;
  mode.u = 1;
  start.u = {1, 0, 0, 0, 0, 0, 0, 0};
  connect(once.y, start.trigger);
  annotation (experiment(StopTime = 1));
end CanModels;
