/* Units of axes: for 1 of each the value in rad or m, rad/s or m/s, N.m or N, A. Made from
 * ecatd.description.units by `PYTHONPATH=tools .venv/bin/python -m ecatdev.axis_units`. */
#ifndef ECAT_AXIS_UNITS_H
#define ECAT_AXIS_UNITS_H

enum axis_quantity { AXIS_POSITION, AXIS_VELOCITY, AXIS_TORQUE, AXIS_CURRENT };

static const struct axis_unit {
  const char *name;
  int quantity, linear;
  double factor;
} UNITS[] = {
    {"rad", AXIS_POSITION, 0, 1},
    {"mrad", AXIS_POSITION, 0, 0.001},
    {"deg", AXIS_POSITION, 0, 0.017453292519943295},
    {"°", AXIS_POSITION, 0, 0.017453292519943295},
    {"rev", AXIS_POSITION, 0, 6.283185307179586},
    {"m", AXIS_POSITION, 1, 1},
    {"mm", AXIS_POSITION, 1, 0.001},
    {"um", AXIS_POSITION, 1, 1e-06},
    {"µm", AXIS_POSITION, 1, 1e-06},
    {"rad/s", AXIS_VELOCITY, 0, 1.0},
    {"deg/s", AXIS_VELOCITY, 0, 0.017453292519943295},
    {"°/s", AXIS_VELOCITY, 0, 0.017453292519943295},
    {"rev/s", AXIS_VELOCITY, 0, 6.283185307179586},
    {"rpm", AXIS_VELOCITY, 0, 0.10471975511965977},
    {"1/min", AXIS_VELOCITY, 0, 0.10471975511965977},
    {"m/s", AXIS_VELOCITY, 1, 1.0},
    {"mm/s", AXIS_VELOCITY, 1, 0.001},
    {"m/min", AXIS_VELOCITY, 1, 0.016666666666666666},
    {"N.m", AXIS_TORQUE, 0, 1.0},
    {"Nm", AXIS_TORQUE, 0, 1.0},
    {"mN.m", AXIS_TORQUE, 0, 0.001},
    {"kN.m", AXIS_TORQUE, 0, 1000.0},
    {"N", AXIS_TORQUE, 1, 1},
    {"kN", AXIS_TORQUE, 1, 1000.0},
    {"A", AXIS_CURRENT, 0, 1},
    {"mA", AXIS_CURRENT, 0, 0.001},
};

#endif
