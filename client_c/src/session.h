/* Functions that the source files of a session share. */
#ifndef ECAT_SESSION_PARTS_H
#define ECAT_SESSION_PARTS_H

#include <ecat/ecat_session.h>

/* The words with which messages about a slave begin; never NULL. */
const char *session_heading(const ecat_session_slave *slave);
/* Whether a failure may end by itself. */
int session_passes(int code);
/* The setting of the program for this failure (enum ecat_failure); ECAT_FAILURE_ERROR for a failure that
 * cannot end by itself. */
int session_wish(const ecat_session *session, int code);
/* Connects if necessary and takes a sample, without waiting. Returns 0 or a negative code. */
int session_refresh(ecat_session *session);
/* Handles a failure according to session_wish(): ends, waits or goes on. 0: the bus is there again, or the
 * program goes on without it (`outage` is set then). */
int session_endure(ecat_session *session, int code);
void session_end_outage(ecat_session *session);
void session_observe_nothing(ecat_session *session); /* marks bus and slaves as not available */
void session_sleep_until(uint64_t ns); /* CLOCK_MONOTONIC */
/* Handles a failure of writing or sending: claims outputs that were lost again, and goes on as the settings say. */
int session_not_written(ecat_session *session, int code);
void session_forget_claims(ecat_session *session);

/* session_can.c */
int session_can_find(ecat_session_slave *slave);   /* its channel on the bus that has just been connected */
int session_can_resolve(ecat_session *session);    /* the messages of all channels, which were found */
void session_can_flush(ecat_session *session);     /* waits a little until what it has handed over was sent */
void session_can_forget(ecat_session *session);    /* the session begins again */
int session_can_settle(ecat_session *session);     /* sends what waits for signals that were not written */
int session_can_observe(ecat_session *session);    /* reads the frames up to the cycle of the sample */
void session_can_observe_nothing(ecat_session *session);

__attribute__((format(printf, 3, 4))) void session_tell(ecat_session *session, int warning,
                                                        const char *format, ...);

#endif
