/* The state of the distributed clock of one slave, for dc.c and sync.c. */
#ifndef ECAT_ESC_DC_H
#define ECAT_ESC_DC_H

#include <stdbool.h>
#include <stdint.h>

/* Local time as a function of CLOCK_MONOTONIC, linear from `at_ns` on. */
struct local_clock {
    int64_t at_ns;     /* CLOCK_MONOTONIC of the last update */
    int64_t local_ns;  /* local time then, in whole nanoseconds … */
    double fraction;   /* … and the fraction of a nanosecond */
    double drift;      /* error of the oscillator, in ns per ns */
    double trim;       /* correction of the rate by the time control loop, in ns per ns */
    double slew_ns;    /* rest of the correction of the time by the loop */
    int64_t offset_ns; /* local time at power-on */
};

/* Time control loop; reset by a write to 0x0930. */
struct time_loop {
    double difference_ns; /* mean value of register 0x092C */
    unsigned differences; /* number of values in it, limited by the depth of the filter */
    double deviation;     /* mean value of register 0x0932 */
    unsigned deviations;
    int64_t corrected_ns; /* CLOCK_MONOTONIC of the last correction; 0 = none yet */
    double interval_ns;   /* mean time between two corrections */
};

/* A SYNC signal: pulses at `first`, then every `period` (0: one only), in system time. */
struct sync_signal {
    bool on;
    int64_t first, period;
    int64_t passed;       /* pulses that have been reported to the device side */
    int64_t acknowledged; /* pulses that the device has acknowledged */
};

struct sync_unit {
    bool running;
    bool never;       /* the start time has passed, so there are no pulses */
    bool not_near;    /* the start time was not in the near future */
    uint8_t start[8]; /* start time as written; its register shows the next pulse */
    struct sync_signal signals[2];
    uint8_t latched[2]; /* events of the latch units: bit 0 positive edge, bit 1 negative edge */
};

struct dc {
    struct local_clock clock;
    struct time_loop loop;
    struct sync_unit sync;
};

#endif
