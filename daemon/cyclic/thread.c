#include "thread.h"

#include <errno.h>
#include <sched.h>
#include <signal.h>
#include <sys/prctl.h>

int cyclic_thread_start(pthread_t *thread, size_t stack_bytes, void *(*body)(void *),
                        void *argument) {
  pthread_attr_t attributes;
  sigset_t all, before;
  int code;
  sigfillset(&all);
  pthread_attr_init(&attributes);
  pthread_attr_setstacksize(&attributes, stack_bytes);
  pthread_sigmask(SIG_SETMASK, &all, &before);
  code = pthread_create(thread, &attributes, body, argument);
  pthread_sigmask(SIG_SETMASK, &before, NULL);
  pthread_attr_destroy(&attributes);
  return -code;
}

int cyclic_thread_become(const char *name, int32_t priority) {
  struct sched_param parameter = {.sched_priority = priority};
  prctl(PR_SET_NAME, name);
  if (priority <= 0 || sched_setscheduler(0, SCHED_FIFO, &parameter) == 0) return 0;
  return errno;
}
