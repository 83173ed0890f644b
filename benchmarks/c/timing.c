/* Times the function of a slave controller, without calls through Python. */
#define EXPORT __attribute__((visibility("default")))
#include <stddef.h>
#include <stdint.h>
#include <time.h>

typedef int (*process_function)(void *segment, uint8_t *frame, size_t size);

static double now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec * 1e9 + (double)now.tv_nsec;
}

/* Writes `batches` times to `results`: each is the mean time of `calls` calls, in nanoseconds. */
EXPORT void time_process(process_function process, void *segment, uint8_t *frame, size_t size,
                         unsigned calls, unsigned batches, double *results);

void time_process(process_function process, void *segment, uint8_t *frame, size_t size,
                  unsigned calls, unsigned batches, double *results)
{
    for (unsigned batch = 0; batch < batches; batch++) {
        double start = now_ns();
        for (unsigned i = 0; i < calls; i++)
            (void)process(segment, frame, size);
        results[batch] = (now_ns() - start) / calls;
    }
}
