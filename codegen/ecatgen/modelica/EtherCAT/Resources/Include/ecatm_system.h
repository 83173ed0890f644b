/* The parts of the compiler and the operating system that the other headers need. */
#ifndef ECATM_SYSTEM_H
#define ECATM_SYSTEM_H

#include <errno.h>
#include <sched.h> /* struct timespec, even if <time.h> does not declare it */
#include <stdarg.h>
#include <stdio.h>
#include <time.h>

/* ECATM_FORMAT: a function whose argument number `n` is a format as that of printf(). */
#if defined(__GNUC__)
#define ECATM_FUNCTION static __attribute__((unused))
#define ECATM_FORMAT(n) static __attribute__((unused, format(printf, n, n + 1)))
#else
#define ECATM_FUNCTION static
#define ECATM_FORMAT(n) static
#endif

/* With -std=c89, <time.h> declares these only if a feature macro for POSIX is defined before the first
 * system header of the translation unit. Other code may include that header, so a macro here does not
 * help, and missing declarations are made as in Linux. */
#ifndef CLOCK_MONOTONIC
#define CLOCK_MONOTONIC 1
#define TIMER_ABSTIME 1
extern int clock_gettime(int clock, struct timespec *now);
extern int clock_nanosleep(int clock, int flags, const struct timespec *until,
                           struct timespec *rest);
#endif

/* Not declared in C89, but in the C library. */
extern int vsnprintf(char *text, size_t size, const char *format, va_list arguments);

/* Seconds of CLOCK_MONOTONIC: to a few nanoseconds, for as long as a machine is up. */
ECATM_FUNCTION double ecatm_now(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* Returns when ecatm_now() has reached `wake`: at once if it has already. */
ECATM_FUNCTION void ecatm_sleep_until(double wake) {
  struct timespec until;
  if (wake < 0) return;
  until.tv_sec = (time_t)wake;
  until.tv_nsec = (long)(1e9 * (wake - (double)until.tv_sec)) + 1; /* never early by rounding */
  if (until.tv_nsec > 999999999L) until.tv_sec++, until.tv_nsec = 0;
  while (ecatm_now() < wake)
    if (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, NULL) == EINVAL) return;
}

#endif
