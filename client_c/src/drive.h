/* For the parts of a drive only. */
#ifndef ECAT_DRIVE_INTERNAL_H
#define ECAT_DRIVE_INTERNAL_H

#include <ecat/ecat_drive.h>
#include <math.h>

#define DRIVE_SAME_TIME 1e-9 /* seconds; for a tool that evaluates an instant again */

static inline int drive_finite(double value) { return value - value == 0; }

/* A position as a signed 32-bit counter shows it. */
static inline int drive_wrap(double position) {
  double rest = fmod(ecat_round(position), 4294967296.0);
  if (rest >= 2147483648.0) rest -= 4294967296.0;
  if (rest < -2147483648.0) rest += 4294967296.0;
  return (int)rest;
}

/* Whether the drive says that it is in a mode; one that does not say is believed to be. */
static inline int drive_is_in_mode(const ecat_drive *drive, int mode) {
  return !(drive->settings.entries & ECAT_DRIVE_HAS_MODE_DISPLAY) || drive->view.raw.display == mode;
}

/* Rounds, and holds within two limits. */
int drive_hold(double value, double low, double high);
void drive_step(ecat_drive *drive, double time);
/* drive_target.c: the target of the mode, in raw values. */
void drive_target(ecat_drive *drive);

#endif
