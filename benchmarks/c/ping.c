/* A minimal master: sends the frames of one cycle, and waits until all of them are back.
 *
 * usage: ping INTERFACE [options] < FRAMES
 *   --seconds S     how long to measure (1)
 *   --warm-up S     how long to exchange before the measurement (0.05)
 *   --rate HZ       cycles per second on a fixed grid; 0 = the next cycle follows at once (0)
 *   --spin          poll the socket instead of sleeping in it
 *   --counter N     expected sum of all working counters of a cycle (not checked)
 *   --buckets       also print the histogram of the samples: pairs of bucket and count
 *   --first         send a cycle each millisecond, and end when the first one is answered
 *
 * FRAMES are the frames of one cycle, each after its size (16 bits, little-endian). The index of a
 * frame's first datagram is overwritten, to distinguish the frames of a cycle from late ones.
 * A cycle whose frames are not all back after 100 ms counts as lost. Prints one line of JSON;
 * times are nanoseconds.
 */
#include "raw_socket.h"

#include "histogram.h"
#include <errno.h>
#include <inttypes.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>

enum {
    PRIORITY = 80,
    MAX_FRAMES = 64,
    MAX_SAMPLES = 1 << 22,
    TIMEOUT_US = 100000,
    FIRST_TIMEOUT_US = 1000,
    INDEX = 17, /* of the first datagram, after Ethernet header, frame header and command */
    DATAGRAMS = 16
};

static struct {
    const char *interface;
    double seconds, warm_up, rate;
    bool spin, first, buckets;
    long counter;
} options = {.seconds = 1, .warm_up = 0.05, .counter = -1};

static struct {
    size_t size;
    uint8_t data[MAX_FRAME];
} frames[MAX_FRAMES];
static unsigned frame_count;
static uint32_t samples[MAX_SAMPLES];
static uint64_t sample_count, lost_frames, lost_cycles, wrong, late, missed;
static uint8_t next_index;

static void sleep_until(int64_t ns)
{
    struct timespec time = {ns / 1000000000, ns % 1000000000};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &time, NULL) == EINTR) {
    }
}

static unsigned load16(const uint8_t *p) { return (unsigned)(p[0] | p[1] << 8); }

/* Returns the sum of the working counters of all datagrams of a frame. */
static long counters(const uint8_t *frame, size_t size)
{
    long sum = 0;
    bool more = true;
    for (size_t at = DATAGRAMS; more && at + 12 <= size;) {
        unsigned flags = load16(frame + at + 6), length = flags & 0x7FF;
        if (at + 12 + length > size)
            break;
        sum += load16(frame + at + 10 + length);
        more = (flags & 0x8000) != 0;
        at += 12 + length;
    }
    return sum;
}

/* Receives one frame of this cycle; returns its number in the cycle, or -1 after the timeout. */
static int receive(int fd, uint8_t base, int64_t deadline, long *sum)
{
    static uint8_t frame[MAX_FRAME];
    for (;;) {
        ssize_t size = recv(fd, frame, sizeof frame, options.spin ? MSG_DONTWAIT : 0);
        if (size < DATAGRAMS + 12) {
            if (size < 0 && errno != EAGAIN && errno != EINTR)
                fail("receive");
            if (now_ns() >= deadline)
                return -1;
            continue;
        }
        unsigned which = (uint8_t)(frame[INDEX] - base);
        if (which < frame_count && (size_t)size >= frames[which].size) {
            *sum += counters(frame, (size_t)size);
            return (int)which;
        }
        late++;
    }
}

/* Sends all frames of a cycle and waits for them; returns nanoseconds, or -1 if one is lost. */
static int64_t exchange(int fd, int64_t timeout_us)
{
    bool back[MAX_FRAMES] = {false};
    uint8_t base = next_index;
    unsigned pending = frame_count;
    long sum = 0;
    int64_t start = now_ns(), deadline = start + timeout_us * 1000;
    next_index = (uint8_t)(next_index + frame_count);
    for (unsigned i = 0; i < frame_count; i++) {
        frames[i].data[INDEX] = (uint8_t)(base + i);
        if (send(fd, frames[i].data, frames[i].size, 0) < 0 && errno != ENOBUFS)
            fail("send");
    }
    while (pending > 0) {
        int which = receive(fd, base, deadline, &sum);
        if (which < 0) {
            lost_frames += pending;
            lost_cycles++;
            return -1;
        }
        if (!back[which])
            pending--;
        back[which] = true;
    }
    int64_t end = now_ns();
    if (options.counter >= 0 && sum != options.counter)
        wrong++;
    return end - start;
}

/* Exchanges for some seconds; returns the seconds taken. */
static double run(int fd, double seconds)
{
    int64_t start = now_ns(), end = start + (int64_t)(seconds * 1e9), due = start, now = start;
    int64_t period = options.rate > 0 ? (int64_t)(1e9 / options.rate) : 0;
    while (now < end && sample_count < MAX_SAMPLES) {
        if (period > 0) {
            for (due += period; due < now; due += period)
                missed++; /* skips a missed deadline, but keeps to the grid */
            sleep_until(due);
        }
        int64_t taken = exchange(fd, TIMEOUT_US);
        if (taken >= 0)
            samples[sample_count++] = taken < UINT32_MAX ? (uint32_t)taken : UINT32_MAX;
        now = now_ns();
    }
    return (double)(now - start) / 1e9;
}

static int compare(const void *a, const void *b)
{
    uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

static uint32_t quantile(double q)
{
    return sample_count == 0 ? 0 : samples[(uint64_t)(q * (double)(sample_count - 1))];
}

/* Returns how often this process has gone to sleep so far. */
static long sleeps(void)
{
    struct rusage usage = {0};
    (void)getrusage(RUSAGE_SELF, &usage);
    return usage.ru_nvcsw;
}

static void report(double seconds, bool real_time, long slept)
{
    qsort(samples, sample_count, sizeof samples[0], compare);
    printf("{\"cycles\": %" PRIu64 ", \"frames\": %u, \"seconds\": %.6f, \"rate\": %.1f, "
           "\"lost_frames\": %" PRIu64 ", \"lost_cycles\": %" PRIu64 ", \"wrong\": %" PRIu64
           ", \"late_frames\": %" PRIu64 ", \"missed_cycles\": %" PRIu64 ", \"real_time\": %s, "
           "\"sleeps\": %ld, "
           "\"min\": %u, \"p50\": %u, \"p90\": %u, \"p99\": %u, \"p999\": %u, \"max\": %u",
           sample_count, frame_count, seconds, (double)sample_count / seconds, lost_frames,
           lost_cycles, wrong, late, missed, real_time ? "true" : "false", slept, quantile(0),
           quantile(0.5), quantile(0.9), quantile(0.99), quantile(0.999), quantile(1));
    if (options.buckets)
        print_buckets(samples, sample_count);
    printf("}\n");
}

/* Prints when the first cycle is answered: CLOCK_MONOTONIC, in seconds. */
static void wait_for_first(int fd)
{
    int64_t due = now_ns();
    while (exchange(fd, FIRST_TIMEOUT_US) < 0) {
        due += 1000000;
        sleep_until(due);
    }
    printf("{\"first_answer\": %.6f}\n", (double)now_ns() / 1e9);
}

static void read_frames(void)
{
    uint8_t size[2];
    while (fread(size, 1, 2, stdin) == 2) {
        size_t length = load16(size);
        if (frame_count == MAX_FRAMES || length > MAX_FRAME || length < DATAGRAMS + 12 ||
            fread(frames[frame_count].data, 1, length, stdin) != length) {
            fprintf(stderr, "ping: wrong frames on standard input\n");
            exit(2);
        }
        frames[frame_count++].size = length;
    }
    if (frame_count == 0) {
        fprintf(stderr, "ping: no frames on standard input\n");
        exit(2);
    }
}

static void read_options(int count, char **arguments)
{
    for (int i = 1; i < count; i++) {
        const char *name = arguments[i];
        double *number = strcmp(name, "--seconds") == 0   ? &options.seconds
                         : strcmp(name, "--warm-up") == 0 ? &options.warm_up
                         : strcmp(name, "--rate") == 0    ? &options.rate
                                                          : NULL;
        if (number != NULL && i + 1 < count)
            *number = atof(arguments[++i]);
        else if (strcmp(name, "--counter") == 0 && i + 1 < count)
            options.counter = atol(arguments[++i]);
        else if (strcmp(name, "--spin") == 0)
            options.spin = true;
        else if (strcmp(name, "--buckets") == 0)
            options.buckets = true;
        else if (strcmp(name, "--first") == 0)
            options.first = true;
        else if (name[0] != '-' && options.interface == NULL)
            options.interface = name;
        else {
            fprintf(stderr, "ping: unknown argument '%s'\n", name);
            exit(2);
        }
    }
    if (options.interface == NULL) {
        fprintf(stderr, "ping: which interface?\n");
        exit(2);
    }
}

int main(int count, char **arguments)
{
    die_with_parent();
    read_options(count, arguments);
    read_frames();
    int fd = open_raw_socket(options.interface, options.first ? FIRST_TIMEOUT_US : TIMEOUT_US);
    bool real_time = ask_for_real_time(PRIORITY);
    if (options.first) {
        wait_for_first(fd);
        return 0;
    }
    memset(samples, 0, sizeof samples); /* avoids page faults later */
    (void)run(fd, options.warm_up);
    sample_count = lost_frames = lost_cycles = wrong = late = missed = 0;
    long before = sleeps();
    double seconds = run(fd, options.seconds);
    report(seconds, real_time, sleeps() - before);
    return 0;
}
