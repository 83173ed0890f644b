/* Keeps a processor from sleeping, at the lowest priority there is: whoever wants it gets it.
 *
 * SCHED_IDLE is a rank within a session only, where the kernel groups processes by session
 * (CONFIG_SCHED_AUTOGROUP): the daemon, which begins sessions of its own, got nothing for minutes
 * beside the loop. So the loop has a session of its own, too, and that the lowest rank of sessions.
 *
 * usage: awake      (runs until it is killed)
 */
#include "wire.h"

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
