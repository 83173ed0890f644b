package DriveModels "Models with the drive of the rig troll"
  partial model Troll
    inner EtherCAT.EtherCATMaster etherCATMaster(waitForBus = true);
    Modelica.Blocks.Sources.BooleanConstant enable(k = true);
    EtherCAT.Drives.Elmo drive(encoderResolution = 65536, ratedTorque = 0.4, ratedCurrent = 5);
  equation
    connect(enable.y, drive.enable);
  end Troll;

  model SpeedLoop "The controller of the speed is in the model"
    extends Troll(drive(mode = EtherCAT.Types.DriveMode.CyclicTorque));
    EtherCAT.Sources.PointToPoint reference(
      distance = 40, maxSpeed = 30, maxAcceleration = 60, startTime = 0.5);
    Modelica.Blocks.Continuous.LimPID controller(
      controllerType = Modelica.Blocks.Types.SimpleController.PI, k = 0.02, Ti = 0.1, yMax = 0.6);
  equation
    connect(reference.y, controller.u_s);
    connect(drive.w, controller.u_m);
    connect(controller.y, drive.tau_ref);
  end SpeedLoop;

  model Feedthrough "The reference depends on what is measured at the same instant, without a state"
    extends Troll(drive(mode = EtherCAT.Types.DriveMode.CyclicVelocity));
    Modelica.Blocks.Math.Feedback error;
    Modelica.Blocks.Math.Gain gain(k = 10);
    Modelica.Blocks.Sources.Step goal(height = 5, startTime = 0.5, offset = start);
    parameter Real start = 0 "Angle at the start";
  equation
    connect(goal.y, error.u1);
    connect(drive.phi, error.u2);
    connect(error.y, gain.u);
    connect(gain.y, drive.w_ref);
  end Feedthrough;

  model Position "A reference that is far from the angle of the drive at the start"
    extends Troll(drive(mode = EtherCAT.Types.DriveMode.CyclicPosition));
    Modelica.Blocks.Sources.Ramp reference(height = 3, duration = 1, offset = -77, startTime = 0.5);
  equation
    connect(reference.y, drive.phi_ref);
  end Position;

  model Away "Leaves the drive far from zero"
    extends Troll;
    Modelica.Blocks.Sources.Trapezoid reference(
      amplitude = 40, rising = 0.2, width = 0.6, falling = 0.2, period = 10, startTime = 0.3);
  equation
    connect(reference.y, drive.w_ref);
  end Away;
end DriveModels;
