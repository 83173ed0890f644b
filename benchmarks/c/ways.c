/* Three ways to notice that a process was killed: a lock of the kernel on a byte of a file (F_OFD_SETLKW), a
 * pidfd, and a robust mutex. A thread waits for each of them, in the same rounds.
 *
 * usage: ways FOLDER ROUNDS MEGABYTES KIND
 * MEGABYTES: memory that the victim has written to. KIND:
 *   alone    nothing of the victim is left
 *   forked   it has forked a child, which lives on
 *   hidden   it is in another PID namespace, and says its number there
 *   thread   only the thread that has taken part ends; the process lives on
 * Prints as JSON for each way the times from the kill to the report, in us. A way that has not reported a
 * dead process, or has reported a living one, after PATIENCE has no times.
 */
#include "median.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

enum { WAYS = 3, LOCK = 0, PIDFD = 1, MUTEX = 2 };
static const double PATIENCE = 1e9;
static const char *const NAMES[WAYS] = {"lock", "pidfd", "mutex"};
static const char *path, *kind;
static size_t megabytes;

static struct shared {
    pthread_mutex_t mutex;
    int ready;
    int pid;   /* of the victim, as it says */
    int outer; /* the same, as this process sees it */
    int child;
} *shared; /* with the victim */

static struct waiter {
    pthread_t thread;
    int fd; /* PIDFD */
    double at;
} waiters[WAYS];

static void fail(const char *what)
{
    perror(what);
    exit(1);
}

static int lock(int command, short type)
{
    struct flock byte = {.l_type = type, .l_whence = SEEK_SET, .l_start = 1, .l_len = 1};
    int fd = open(path, O_RDWR | O_CLOEXEC);
    if (fd < 0)
        fail(path);
    return fcntl(fd, command, &byte) == 0 ? fd : -1;
}

static int is(const char *word)
{
    return strcmp(kind, word) == 0;
}

static void *take_part(void *nothing)
{
    (void)nothing;
    if (lock(F_OFD_SETLK, F_WRLCK) < 0 || pthread_mutex_lock(&shared->mutex) != 0)
        _exit(1);
    return NULL;
}

static void live(void)
{
    char *memory = malloc((megabytes << 20) + 1);
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    memset(memory, 1, (megabytes << 20) + 1);
    if (is("thread")) {
        pthread_t thread;
        pthread_create(&thread, NULL, take_part, NULL);
        pthread_join(thread, NULL);
    } else {
        take_part(NULL);
    }
    shared->pid = (int)getpid();
    if (is("forked")) {
        pid_t child = fork();
        if (child == 0)
            for (;;)
                pause();
        shared->child = (int)child;
    }
    __atomic_store_n(&shared->ready, 1, __ATOMIC_RELEASE);
    for (;;)
        pause();
}

/* Starts the victim, in "hidden" as a child of a process with another PID namespace for its children. */
static pid_t start(void)
{
    pid_t pid;
    memset(shared, 0, sizeof *shared);
    pthread_mutexattr_t attributes;
    pthread_mutexattr_init(&attributes);
    pthread_mutexattr_setpshared(&attributes, PTHREAD_PROCESS_SHARED);
    pthread_mutexattr_setrobust(&attributes, PTHREAD_MUTEX_ROBUST);
    pthread_mutex_init(&shared->mutex, &attributes);
    pid = fork();
    if (pid == 0 && is("hidden")) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        if (unshare(CLONE_NEWPID) != 0)
            fail("unshare");
        if ((pid = fork()) > 0) {
            shared->outer = (int)pid;
            waitpid(pid, NULL, 0);
            _exit(0);
        }
    }
    if (pid == 0)
        live();
    while (!__atomic_load_n(&shared->ready, __ATOMIC_ACQUIRE)) {
        if (waitpid(pid, NULL, WNOHANG) != 0)
            exit(1);
        usleep(100);
    }
    if (!is("hidden"))
        shared->outer = (int)pid;
    return pid;
}

static void *wait_for_lock(void *argument)
{
    struct waiter *waiter = argument;
    int fd = lock(F_OFD_SETLKW, F_RDLCK);
    waiter->at = now_ns();
    close(fd);
    return NULL;
}

static void *wait_for_pidfd(void *argument)
{
    struct waiter *waiter = argument;
    struct pollfd ready = {.fd = waiter->fd, .events = POLLIN};
    while (poll(&ready, 1, -1) != 1)
        continue;
    waiter->at = now_ns();
    return NULL;
}

static void *wait_for_mutex(void *argument)
{
    struct waiter *waiter = argument;
    (void)pthread_mutex_lock(&shared->mutex); /* EOWNERDEAD */
    waiter->at = now_ns();
    return NULL;
}

/* One round; returns which ways have reported, and fills in their times in us. */
static void round_of(double *found)
{
    static void *(*const bodies[WAYS])(void *) = {wait_for_lock, wait_for_pidfd, wait_for_mutex};
    pid_t pid = start();
    double killed;
    struct timespec end;
    int way;
    waiters[PIDFD].fd = (int)syscall(SYS_pidfd_open, shared->pid, 0);
    for (way = 0; way < WAYS; way++) {
        waiters[way].at = 0;
        if (way == PIDFD && waiters[way].fd < 0)
            continue;
        pthread_create(&waiters[way].thread, NULL, bodies[way], &waiters[way]);
    }
    usleep(5000);
    killed = now_ns();
    if (!is("thread"))
        kill(shared->outer, SIGKILL);
    clock_gettime(CLOCK_REALTIME, &end);
    end.tv_sec += (time_t)(PATIENCE / 1e9);
    for (way = 0; way < WAYS; way++) {
        found[way] = -1;
        if (way == PIDFD && waiters[way].fd < 0)
            continue;
        if (pthread_timedjoin_np(waiters[way].thread, NULL, &end) == 0) {
            double late = waiters[way].at - killed;
            found[way] = late > 0 ? late / 1e3 : 0;
        }
        else {
            pthread_cancel(waiters[way].thread);
            if (way == MUTEX) /* no cancellation point */
                pthread_detach(waiters[way].thread);
            else
                pthread_join(waiters[way].thread, NULL);
        }
    }
    if (shared->child > 0)
        kill(shared->child, SIGKILL);
    kill(pid, SIGKILL);
    waitpid(pid, NULL, 0);
    if (waiters[PIDFD].fd >= 0)
        close(waiters[PIDFD].fd);
}

int main(int argc, char **argv)
{
    unsigned round, rounds;
    double (*found)[WAYS];
    char file[256];
    int way;
    if (argc != 5)
        return 2;
    snprintf(file, sizeof file, "%s/ways.lock", argv[1]);
    path = file;
    rounds = (unsigned)atoi(argv[2]);
    megabytes = (size_t)atol(argv[3]);
    kind = argv[4];
    shared = mmap(NULL, sizeof *shared, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    found = calloc(rounds, sizeof *found);
    if (shared == MAP_FAILED || found == NULL || close(open(path, O_RDWR | O_CREAT, 0600)) != 0)
        fail("memory");
    prctl(PR_SET_TIMERSLACK, 1);
    for (round = 0; round < rounds; round++)
        round_of(found[round]);
    printf("{");
    for (way = 0; way < WAYS; way++) {
        unsigned count = 0;
        printf("%s\"%s\": [", way > 0 ? ", " : "", NAMES[way]);
        for (round = 0; round < rounds; round++)
            if (found[round][way] >= 0)
                printf("%s%.1f", count++ > 0 ? ", " : "", found[round][way]);
        printf("]");
    }
    printf("}\n");
    return 0;
}
