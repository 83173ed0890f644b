/* Drives: what messages say about them. */
#include "drive.h"
#include "drive_errors.h"

#include <stdio.h>

const char *ecat_drive_state_text(int state) {
  static const char *const texts[] = {"not ready to switch on", "switch on disabled", "ready to switch on",
                                      "switched on", "operation enabled", "quick stop active",
                                      "fault reaction active", "fault"};
  return state >= ECAT_DRIVE_NOT_READY && state <= ECAT_DRIVE_FAULT ? texts[state - 1] : "";
}

const char *ecat_drive_mode_text(int mode) {
  static const char *const texts[] = {"", "profile position", "", "profile velocity", "profile torque", "", "homing",
                                      "", "cyclic synchronous position", "cyclic synchronous velocity",
                                      "cyclic synchronous torque"};
  return mode > 0 && mode < (int)(sizeof texts / sizeof *texts) ? texts[mode] : "";
}

static const char *find(const drive_error *table, size_t count, int code) {
  size_t i;
  for (i = 0; i < count; i++)
    if (table[i].code == code) return table[i].text;
  return NULL;
}

const char *ecat_drive_error_text(int code) {
  const char *text = find(ERRORS, sizeof ERRORS / sizeof *ERRORS, code);
  int high = code >> 8 & 0xFF, main_class = (high & 0xF0) != 0 ? high & 0xF0 : high;
  if (text == NULL) text = find(CLASSES, sizeof CLASSES / sizeof *CLASSES, high);
  if (text == NULL) text = find(CLASSES, sizeof CLASSES / sizeof *CLASSES, main_class);
  return text != NULL ? text : "unknown class";
}

/* Why the drive is not in operation, as far as the program decides that; NULL: it does not. */
static const char *reason(const ecat_drive *drive) {
  const ecat_drive_order *order = &drive->order;
  if (order->trip != NULL) return order->trip;
  return order->request.enable && drive->settings.restart == ECAT_DRIVE_EDGE ? order->waits : NULL;
}

char *ecat_drive_explain(const ecat_drive *drive, char text[ECAT_DRIVE_TEXT]) {
  const ecat_drive_view *view = &drive->view;
  const char *why = reason(drive), *error = ecat_drive_error_text(view->raw.error);
  size_t used = 0;
  if (!view->connected)
    used = (size_t)snprintf(text, ECAT_DRIVE_TEXT, "axis %.64s: not connected", drive->settings.name);
  else
    used = (size_t)snprintf(text, ECAT_DRIVE_TEXT, "axis %.64s: %s (0x%04X)", drive->settings.name,
                            ecat_drive_state_text(view->state), (unsigned)view->raw.status & 0xFFFFu);
  if (view->connected && view->state >= ECAT_DRIVE_FAULT_REACTION &&
      (drive->settings.entries & ECAT_DRIVE_HAS_ERROR_CODE) && view->raw.error != 0)
    used += (size_t)snprintf(text + used, ECAT_DRIVE_TEXT - used, ", error code 0x%04X%s%s%s",
                             (unsigned)view->raw.error & 0xFFFFu, *error != '\0' ? " (" : "", error,
                             *error != '\0' ? ")" : "");
  if (view->connected && (view->raw.status & 0x0800) != 0)
    used += (size_t)snprintf(text + used, ECAT_DRIVE_TEXT - used, ", a limit of the drive is active");
  if (why != NULL)
    (void)snprintf(text + used, ECAT_DRIVE_TEXT - used, "; it stays off until enable is switched off and on, because %s",
                   why);
  return text;
}
