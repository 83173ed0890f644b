/* Keeps a processor from sleeping, at the lowest priority there is: whoever wants it gets it.
 *
 * usage: awake      (runs until it is killed)
 */
#include "wire.h"

int main(void)
{
    struct sched_param parameter = {.sched_priority = 0};
    die_with_parent();
    if (sched_setscheduler(0, SCHED_IDLE, &parameter) != 0)
        fail("SCHED_IDLE");
    for (volatile unsigned turns = 0;; turns++) {
    }
}
