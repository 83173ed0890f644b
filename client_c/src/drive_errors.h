/* Error codes of drives (object 0x603F) and their classes, made from daemon/ecatd/etg by
 * `PYTHONPATH=tools .venv/bin/python -m ecatdev.drive_errors`. */
#ifndef ECAT_DRIVE_ERRORS_H
#define ECAT_DRIVE_ERRORS_H

typedef struct drive_error {
  int code;
  const char *text;
} drive_error;

static const drive_error ERRORS[] = {
    {0x2310, "continuous overcurrent"},
    {0x2320, "short circuit or earth leakage"},
    {0x2330, "earth leakage"},
    {0x2340, "short circuit"},
    {0x2350, "load too high for too long (I²t)"},
    {0x3110, "mains overvoltage"},
    {0x3120, "mains undervoltage"},
    {0x3130, "phase failure"},
    {0x3210, "overvoltage of the DC link"},
    {0x3220, "undervoltage of the DC link"},
    {0x4210, "device too hot"},
    {0x4310, "drive too hot"},
    {0x6320, "wrong parameter"},
    {0x7121, "motor blocked"},
    {0x7122, "motor or commutation"},
    {0x7305, "first encoder"},
    {0x8311, "torque too high"},
    {0x8611, "following error: it lags behind its target by more than its window, object 0x6065"},
    {0x8612, "target beyond its limits"},
};

static const drive_error CLASSES[] = {
    {0x00, "error reset"},
    {0x10, "generic error"},
    {0x20, "current"},
    {0x21, "current, input side"},
    {0x22, "current inside the device"},
    {0x23, "current, output side"},
    {0x30, "voltage"},
    {0x31, "mains voltage"},
    {0x32, "voltage inside the device"},
    {0x33, "output voltage"},
    {0x40, "temperature"},
    {0x41, "ambient temperature"},
    {0x42, "device temperature"},
    {0x50, "device hardware"},
    {0x60, "device software"},
    {0x61, "internal software"},
    {0x62, "user software"},
    {0x63, "data set"},
    {0x70, "additional modules"},
    {0x80, "monitoring"},
    {0x81, "communication"},
    {0x82, "protocol error"},
    {0x90, "external error"},
    {0xA0, "state change refused"},
    {0xF0, "additional functions"},
    {0xFF, "device specific"},
};

#endif
