/* Threads of this library. Their stacks are small, since all memory may be locked. They block all signals,
 * which are for the threads of the control side. */
#ifndef ECAT_THREAD_H
#define ECAT_THREAD_H

#include <pthread.h>
#include <stddef.h>
#include <stdint.h>

/* Starts `body(argument)`; 0 or -errno. */
int cyclic_thread_start(pthread_t *thread, size_t stack_bytes, void *(*body)(void *),
                        void *argument);
/* Names the calling thread and gives it SCHED_FIFO `priority`, unless that is 0; 0 or errno. */
int cyclic_thread_become(const char *name, int32_t priority);

#endif
