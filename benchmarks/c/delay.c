/* The delay from sample to wire. The program samples the number of a cycle and writes it to a slave
 * that returns its outputs. Then it checks in which cycle the number went out and came back.
 *
 * usage: delay BUS CYCLES PRIORITY
 * The number that is sampled after cycle n must go out, and come back, in cycle n + 1. Prints as
 * JSON, as numbers of cycles:
 *   "exact"  the number went out and came back in cycle n + 1
 *   "late"   this program was too late: its commit had not returned at the deadline of cycle n + 1,
 *            or it slept through a whole cycle
 *   "lost"   the frame was lost
 *   "wrong"  the number came in another cycle, for none of these reasons
 */
#include "bus.h"

#include <fcntl.h>
#include <sched.h>
#include <stdint.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

static const double LEASE = 0.5, PATIENCE = 1.0;

struct grid {
    uint64_t start, period; /* deadline of cycle 1 (CLOCK_MONOTONIC), cycle time; in ns */
};

struct counts {
    unsigned exact, late, lost, wrong;
};

static uint64_t now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (uint64_t)time.tv_sec * 1000000000u + (uint64_t)time.tv_nsec;
}

static struct grid read_grid(const char *bus)
{
    char folder[ECAT_SHM_PATH], path[ECAT_SHM_PATH + 40];
    struct grid grid;
    const uint8_t *map;
    int fd;
    (void)ecat_shm_folder(0, folder);
    snprintf(path, sizeof path, "%s/%s", folder, bus);
    fd = open(path, O_RDONLY);
    map = mmap(NULL, (size_t)lseek(fd, 0, SEEK_END), PROT_READ, MAP_SHARED, fd, 0);
    if (map == MAP_FAILED) {
        perror(path);
        exit(1);
    }
    grid.start =
        ((const ecat_shm_health *)(map + ((const ecat_shm_header *)map)->health_offset))->start_ns;
    grid.period = ((const ecat_shm_header *)map)->cycle_time_ns;
    return grid;
}

static int become_urgent(int priority)
{
    struct sched_param parameter = {.sched_priority = priority};
    (void)mlockall(MCL_CURRENT | MCL_FUTURE);
    return sched_setscheduler(0, SCHED_FIFO, &parameter) == 0;
}

/* Counts what happened to the number that was written after cycle `before`. */
static void judge(ecat_t *bus, const int *entry, const ecat_domain_info *info, uint64_t before,
                  int in_time, struct counts *counts)
{
    int64_t sent = -1, returned = -1, wanted = (int64_t)(before & 0xFFFFFFFFu);
    check(bus, ecat_read_int(bus, entry[0], &sent));
    check(bus, ecat_read_int(bus, entry[1], &returned));
    if (info->cycle != before + 1 || !in_time)
        counts->late++;
    else if (info->wkc_state != ECAT_WKC_COMPLETE)
        counts->lost++;
    else if (sent == wanted && returned == wanted)
        counts->exact++;
    else
        counts->wrong++;
}

static struct counts run(ecat_t *bus, struct grid grid, unsigned cycles)
{
    struct counts counts = {0, 0, 0, 0};
    uint64_t before = 0;
    unsigned i;
    int in_time = 0, entry[2];
    check(bus, entry[0] = ecat_bind(bus, 0, 0x7000, 1, ECAT_OUTPUT));
    check(bus, entry[1] = ecat_bind(bus, 0, 0x6000, 1, ECAT_INPUT));
    check(bus, ecat_claim(bus, 0, LEASE));
    for (i = 0; i <= cycles; i++) {
        ecat_domain_info info;
        check(bus, ecat_wait(bus, 1, PATIENCE));
        check(bus, ecat_sample(bus));
        check(bus, ecat_domain(bus, 0, &info));
        if (i > 0)
            judge(bus, entry, &info, before, in_time, &counts);
        check(bus, ecat_write_int(bus, entry[0], (int64_t)(info.cycle & 0xFFFFFFFFu)));
        check(bus, ecat_commit(bus));
        in_time = now() < grid.start + info.cycle * grid.period;
        before = info.cycle;
    }
    return counts;
}

int main(int count, char **arguments)
{
    ecat_t *bus;
    struct counts counts;
    int urgent;
    if (count != 4) {
        fprintf(stderr, "usage: delay BUS CYCLES PRIORITY\n");
        return 2;
    }
    bus = open_bus(arguments[1]);
    urgent = become_urgent(atoi(arguments[3]));
    counts = run(bus, read_grid(arguments[1]), (unsigned)atoi(arguments[2]));
    ecat_close(bus);
    printf("{\"exact\": %u, \"late\": %u, \"lost\": %u, \"wrong\": %u, \"real_time\": %s}\n",
           counts.exact, counts.late, counts.lost, counts.wrong, urgent ? "true" : "false");
    return 0;
}
