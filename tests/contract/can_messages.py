"""A DBC file, and a program that makes the calls of the block that is generated of it."""

DBC = """VERSION ""
NS_ :
BS_:
BU_: ECU DRIVE OTHER

BO_ 385 Motor: 8 DRIVE
 SG_ Speed : 7|16@0- (0.1,0) [-3200|3200] "rpm" ECU
 SG_ Page M : 16|8@1+ (1,0) [0|0] "" ECU
 SG_ Temperature m1 : 24|8@1+ (1,-40) [0|0] "degC" ECU
 SG_ Voltage m2 : 24|8@1+ (0.5,0) [0|0] "V" ECU
 SG_ Torque : 32|32@1- (1,0) [0|0] "N.m" ECU

BO_ 2566844926 Command: 8 ECU
 SG_ Target : 0|32@1- (0.001,0) [-100|100] "rad/s" DRIVE
 SG_ Enable : 32|1@1+ (1,0) [0|1] "" DRIVE
 SG_ model : 47|8@0- (1,0) [-5|5] "" DRIVE

BO_ 12 Foreign: 8 OTHER
 SG_ Value : 0|8@1+ (1,0) [0|0] "" DRIVE

CM_ BO_ 385 "What the drive measures";
CM_ SG_ 385 Speed "of the shaft";
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 10000;
BA_DEF_DEF_ "GenMsgCycleTime" 0;
BA_ "GenMsgCycleTime" BO_ 385 100000;
SIG_VALTYPE_ 385 Torque : 1;
VAL_ 385 Page 1 "temperature" 2 "voltage" ;
"""
"""The model is the node ECU. The period of Motor gives it a timeout that no test waits for."""

MOTOR, COMMAND = 0x181, 0x18FEF1FE

PROGRAM = """
#include "Plant.h"
int main(int argc, char **argv) {
  static Plant plant;
  Plant_CanTerminal *can = &plant.canTerminal;
  double time, target, age;
  int enable, model, cycle, i, repeat = 1, missed, state, counter, expected;
  int sending, receiving, received, sent, waiting, overflows, offs;
  void *master = ecatm_master_open(argv[1], 1, atof(argv[2]), 1, atof(argv[3]), 1, atoi(argv[4]),
                                   0, 0, 0, "");
  Plant_open(&plant, master, 1);
  (void)argc;
  printf("open\\n");
  fflush(stdout);
  while (scanf("%lf %lf %d %d %d", &time, &target, &enable, &model, &repeat) == 5) {
    cycle = ecatm_wait(master, time);
    ecatm_master_state(master, time, cycle, &age, &missed, &state, &counter, &expected);
    Plant_read(&plant, time, cycle);
    can->commandTarget = target;
    can->commandEnable = enable;
    can->commandModel = model;
    for (i = 0; i < repeat; i++) {
      Plant_CanTerminal_read(can, time, cycle);
      Plant_CanTerminal_write(can, time, cycle);
    }
    state = ecatm_can_state(can->slave, time, cycle, &sending, &receiving, &received, &sent,
                            &waiting, &overflows, &offs);
    printf("%d %d %.17g %d %.17g %.17g %.17g %d %.9g %d %d %d\\n", cycle, can->valid,
           can->motorSpeed, can->motorPage, can->motorTemperature, can->motorVoltage,
           can->motorTorque, can->motorValid, can->motorAge, can->motorCount, can->commandCount,
           state);
    fflush(stdout);
  }
  Plant_close(&plant);
  ecatm_master_close(master);
  return 0;
}
"""
"""Arguments: bus, sample time, lease, whenFailed. Each line of its input has a time, the values of
the signals that it sends, and how often the calls of this time are made."""
