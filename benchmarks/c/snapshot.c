/* Times a snapshot of the process image with 20 reads by handle. Also times the minimum: a copy of
 * the same bytes from the same memory, and 20 plain loads.
 *
 * usage: snapshot BUS READERS SECONDS PROCESSOR...
 * READERS processes measure at the same time. In each, both take turns of some microseconds. The
 * processes are pinned to the given processors, one after the other. Prints the medians of each
 * process as JSON. A turn in which the scheduler took the processor away is far from the median. So
 * even with more readers than processors, the medians are times of readers that run.
 */
#include "bus.h"
#include "median.h"

#include <fcntl.h>
#include <sched.h>
#include <signal.h>
#include <stdint.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

enum { READS = 20, TURN = 100, MOST_READERS = 256, MOST_TURNS = 200000, MOST_BYTES = 1 << 16 };

struct result {
    double sample, plain, ratio;
    unsigned turns;
};

struct shared {
    int ready, start;
    struct result result[MOST_READERS];
};

/* The process image in shared memory, for reads without the client library. */
struct image {
    const uint8_t *at;
    size_t size;
    unsigned offset[READS];
};

static struct image map_image(ecat_t *bus, const int *entries)
{
    char folder[ECAT_SHM_PATH], path[ECAT_SHM_PATH + 40];
    struct image image;
    const uint8_t *map;
    const ecat_shm_header *header;
    const ecat_shm_domain *domain;
    int i, fd;
    (void)ecat_shm_folder(0, folder);
    snprintf(path, sizeof path, "%s/%s", folder, ecat_name(bus));
    fd = open(path, O_RDONLY);
    map = mmap(NULL, (size_t)lseek(fd, 0, SEEK_END), PROT_READ, MAP_SHARED, fd, 0);
    if (map == MAP_FAILED) {
        perror(path);
        exit(1);
    }
    header = (const void *)map;
    domain = (const void *)(map + header->domains_offset);
    image.at = map + domain->page_offset + sizeof(ecat_shm_page);
    image.size = domain->image_bytes;
    if (image.size > MOST_BYTES) {
        fprintf(stderr, "snapshot: an image of %zu bytes is too long\n", image.size);
        exit(2);
    }
    for (i = 0; i < READS; i++) {
        ecat_signal_info info;
        check(bus, ecat_signal(bus, entries[i], &info));
        image.offset[i] = info.bit_offset / 8;
    }
    return image;
}

static void read_by_handle(ecat_t *bus, const int *entries)
{
    double values[READS];
    int i;
    check(bus, ecat_sample(bus));
    for (i = 0; i < READS; i++)
        (void)ecat_read(bus, entries[i], &values[i]);
    keep(values);
}

static void read_plainly(const struct image *image)
{
    static uint8_t copy[MOST_BYTES + 8];
    double values[READS];
    int i;
    memcpy(copy, image->at, image->size);
    keep(copy);
    for (i = 0; i < READS; i++) {
        uint32_t value;
        memcpy(&value, copy + image->offset[i], sizeof value);
        values[i] = value;
    }
    keep(values);
}

static struct result measure(ecat_t *bus, double seconds)
{
    static double sample[MOST_TURNS], plain[MOST_TURNS], ratio[MOST_TURNS];
    int entries[READS], i;
    struct image image;
    struct result result;
    unsigned turn;
    double end = now_ns() + seconds * 1e9, start, between, now, idle;
    choose(bus, entries, READS);
    image = map_image(bus, entries);
    for (turn = 0, now = 0; turn < MOST_TURNS && (now < end || turn < 10); turn++) {
        idle = settling(TURN);
        start = now_ns();
        for (i = 0; i < TURN; i++) {
            read_by_handle(bus, entries);
            settle();
        }
        between = now_ns();
        for (i = 0; i < TURN; i++) {
            read_plainly(&image);
            settle();
        }
        now = now_ns();
        sample[turn] = (between - start) / TURN - idle;
        plain[turn] = (now - between) / TURN - idle;
        ratio[turn] = sample[turn] / plain[turn];
    }
    result.turns = turn;
    result.sample = median(sample, turn);
    result.plain = median(plain, turn);
    result.ratio = median(ratio, turn);
    return result;
}

static int reader(const char *name, struct shared *shared, int number, int processor,
                  double seconds)
{
    cpu_set_t only;
    ecat_t *bus = open_bus(name);
    CPU_ZERO(&only);
    CPU_SET(processor, &only);
    if (sched_setaffinity(0, sizeof only, &only) != 0) {
        perror("sched_setaffinity");
        return 1;
    }
    (void)prctl(PR_SET_PDEATHSIG, SIGKILL);
    __atomic_add_fetch(&shared->ready, 1, __ATOMIC_RELEASE);
    while (!__atomic_load_n(&shared->start, __ATOMIC_ACQUIRE))
        usleep(100);
    shared->result[number] = measure(bus, seconds);
    ecat_close(bus);
    return 0;
}

static void print(const struct shared *shared, int readers)
{
    int i;
    printf("[");
    for (i = 0; i < readers; i++)
        printf("%s{\"sample\": %.2f, \"plain\": %.2f, \"ratio\": %.4f, \"turns\": %u}",
               i > 0 ? ", " : "", shared->result[i].sample, shared->result[i].plain,
               shared->result[i].ratio, shared->result[i].turns);
    printf("]\n");
}

int main(int count, char **arguments)
{
    int readers = count > 4 ? atoi(arguments[2]) : 0, i, status, failed = 0;
    struct shared *shared;
    if (readers < 1 || readers > MOST_READERS) {
        fprintf(stderr, "usage: snapshot BUS READERS SECONDS PROCESSOR...\n");
        return 2;
    }
    shared = mmap(NULL, sizeof *shared, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (shared == MAP_FAILED) {
        perror("mmap");
        return 1;
    }
    for (i = 0; i < readers; i++)
        if (fork() == 0)
            return reader(arguments[1], shared, i, atoi(arguments[4 + i % (count - 4)]),
                          atof(arguments[3]));
    while (__atomic_load_n(&shared->ready, __ATOMIC_ACQUIRE) < readers &&
           waitpid(-1, &status, WNOHANG) == 0)
        usleep(100);
    __atomic_store_n(&shared->start, 1, __ATOMIC_RELEASE);
    while (wait(&status) > 0)
        failed |= status != 0;
    print(shared, readers);
    return failed || __atomic_load_n(&shared->ready, __ATOMIC_ACQUIRE) < readers;
}
