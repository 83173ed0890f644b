/* Times the shared memory of Modelica_DeviceDrivers in the way in which its block SharedMemoryRead
 * uses it: copies 256 bytes into a package, and reads 20 integers from the package.
 *
 * usage: device_drivers NAME SECONDS       (NAME: an unused name for the shared memory)
 * The program is built with the headers of that library, which are not part of this project. Prints
 * as JSON the median time of a snapshot with 20 reads while no other process has the semaphore.
 * Also prints whether a reader still waits one second after a process died with the semaphore.
 */
#include "median.h"

#include <MDDSharedMemory.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <sys/prctl.h>
#include <sys/wait.h>

enum { READS = 20, BYTES = 256, TURN = 100, MOST_TURNS = 200000 };

/* Functions that a simulation tool provides to the library. */
void ModelicaFormatMessage(const char *format, ...)
{
    (void)format;
}
void ModelicaError(const char *text)
{
    fprintf(stderr, "%s", text);
    exit(1);
}
void ModelicaFormatError(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    vfprintf(stderr, format, arguments);
    va_end(arguments);
    exit(1);
}
char *ModelicaAllocateStringWithErrorReturn(size_t length)
{
    return malloc(length + 1);
}

static void take(void *memory, void *package)
{
    int values[READS], i;
    MDD_SharedMemoryReadP(memory, package);
    for (i = 0; i < READS; i++)
        MDD_SerialPackagerGetInteger(package, &values[i], 1, MDD_ENDIAN_LITTLE);
    __asm__ volatile("" : : "r"(values) : "memory");
}

static double measure(void *memory, double seconds)
{
    static double times[MOST_TURNS];
    void *package = MDD_SerialPackagerConstructor(BYTES);
    double end = now_ns() + seconds * 1e9, start, idle, now = 0;
    unsigned turn, i;
    for (turn = 0; turn < MOST_TURNS && (now < end || turn < 10); turn++) {
        idle = settling(TURN);
        start = now_ns();
        for (i = 0; i < TURN; i++) {
            take(memory, package);
            settle();
        }
        now = now_ns();
        times[turn] = (now - start) / TURN - idle;
    }
    return median(times, turn);
}

static pid_t begin(void (*act)(void *memory), void *memory)
{
    pid_t child = fork();
    if (child != 0)
        return child;
    (void)prctl(PR_SET_PDEATHSIG, SIGKILL);
    act(memory);
    _exit(0);
}

static void end(pid_t child)
{
    kill(child, SIGKILL);
    waitpid(child, NULL, 0);
}

static void take_once(void *memory)
{
    take(memory, MDD_SerialPackagerConstructor(BYTES));
}

static void hold_and_die(void *memory)
{
    sem_wait(((struct MDDMmap_struct *)memory)->semdes);
    raise(SIGKILL);
}

static int waits_for_the_dead(void *memory)
{
    pid_t child = begin(hold_and_die, memory);
    int status, waits;
    waitpid(child, &status, 0);
    child = begin(take_once, memory);
    usleep(1000000);
    waits = waitpid(child, &status, WNOHANG) == 0;
    if (waits)
        end(child);
    return waits;
}

int main(int count, char **arguments)
{
    void *memory;
    double reads;
    if (count != 3) {
        fprintf(stderr, "usage: device_drivers NAME SECONDS\n");
        return 2;
    }
    memory = MDD_SharedMemoryConstructor(arguments[1], BYTES, 1);
    reads = measure(memory, atof(arguments[2]));
    printf("{\"reads\": %.1f, \"waits\": %s}\n", reads,
           waits_for_the_dead(memory) ? "true" : "false");
    MDD_SharedMemoryDestructor(memory);
    return 0;
}
