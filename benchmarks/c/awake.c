/* Keeps a processor from sleeping, with a busy loop at the lowest priority. Any other program that
 * needs the processor gets it.
 *
 * If the kernel groups processes by session (CONFIG_SCHED_AUTOGROUP), SCHED_IDLE only counts within
 * a session. The daemon begins sessions of its own, and once got no processor time for minutes
 * beside the loop. So the loop has a session of its own, too, with the lowest priority of sessions.
 *
 * usage: awake      (runs until it is killed)
 */
#include "raw_socket.h"

static void lower_session(void)
{
    (void)setsid();
    FILE *rank = fopen("/proc/self/autogroup", "w");
    if (rank == NULL)
        return; /* there are no groups */
    if (fputs("19", rank) == EOF || fclose(rank) == EOF)
        fail("autogroup");
}

int main(void)
{
    struct sched_param parameter = {.sched_priority = 0};
    die_with_parent();
    lower_session();
    if (sched_setscheduler(0, SCHED_IDLE, &parameter) != 0)
        fail("SCHED_IDLE");
    for (volatile unsigned turns = 0;; turns++) {
    }
}
