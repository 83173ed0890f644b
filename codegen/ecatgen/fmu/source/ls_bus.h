/* The CAN bus behind a terminal as the bus simulation of FMI-LS-BUS: virtual ECUs, which are other FMUs, send
 * and receive frames on it through bus terminals.
 *
 *     operations of an ECU -> its queue -> ecat_can_send() ... the terminal says that the frame was sent
 *       -> Confirm to this ECU, Transmit to the others
 *     frames of other nodes and clients -> Transmit to all ECUs
 *
 * All memory is allocated at the beginning; what does not fit is counted and told.
 */
#ifndef LS_BUS_H
#define LS_BUS_H

#include "plant.h"

typedef struct ls_bus ls_bus;

/* One for the ECUs 0 to `count` - 1, or NULL: out of memory. */
ls_bus *ls_bus_new(size_t count);
void ls_bus_free(ls_bus *b);
/* Forgets all frames and operations. */
void ls_bus_clear(ls_bus *b);

/* Finds the channel, after each connection to a daemon. For `check` of ecat_session_settings. */
int ls_bus_found(void *context);
/* Sends what waits and takes what has happened since the last call. These return a code of the session. */
int ls_bus_exchange(plant *p);
/* Takes the operations of all ECUs whose clocks are active, and ends the event: all clocks are inactive. */
int ls_bus_event(plant *p);
/* Waits, for a fraction of a second, until all frames were sent. */
void ls_bus_flush(plant *p);
void ls_bus_publish(plant *p);

/* Values of clocks and binary variables. These return a plant_status. */
int ls_bus_get_clock(plant *p, unsigned reference, int *active);
int ls_bus_set_clock(plant *p, unsigned reference, int active);
int ls_bus_get_binary(plant *p, unsigned reference, const uint8_t **bytes, size_t *length);
int ls_bus_set_binary(plant *p, unsigned reference, const uint8_t *bytes, size_t length);
/* Whether a Tx_Clock that is an output is about to tick. */
int ls_bus_has_event(const plant *p);
/* The time in s from now, or from the last call that has said `*changed`, until a Tx_Clock is to tick. */
int ls_bus_get_interval(plant *p, unsigned reference, double *interval, int *changed);

#endif
