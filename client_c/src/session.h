/* What the parts of a session share. */
#ifndef ECAT_SESSION_PARTS_H
#define ECAT_SESSION_PARTS_H

#include <ecat/ecat_session.h>

/* How sentences about a slave begin: never NULL. */
const char *session_heading(const ecat_session_slave *slave);
/* Whether a failure may end by itself. */
int session_passes(int code);
/* What the program wants in this failure: enum ecat_failure. */
int session_wish(const ecat_session *session, int code);
/* One try to take a new image of the bus as it is now. */
int session_refresh(ecat_session *session);
/* Does in a failure what the program wants. 0: the bus is there again, or the program goes on without
 * it (`outage`). */
int session_endure(ecat_session *session, int code);
void session_end_outage(ecat_session *session);
void session_observe_nothing(ecat_session *session); /* but the last values */
void session_sleep_until(uint64_t ns); /* CLOCK_MONOTONIC */

__attribute__((format(printf, 3, 4))) void session_tell(ecat_session *session, int warning,
                                                        const char *format, ...);

#endif
