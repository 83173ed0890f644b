/* Functions for both ends of the wire: raw socket (like the simulator's), clock, real time. */
#ifndef BENCHMARK_RAW_SOCKET_H
#define BENCHMARK_RAW_SOCKET_H

#include <arpa/inet.h>
#include <linux/if_packet.h>
#include <net/if.h>
#include <sched.h>
#include <signal.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

enum { ETHERTYPE_ECAT = 0x88A4, MAX_FRAME = 2048 };

static inline void fail(const char *what)
{
    perror(what);
    exit(1);
}

static inline int64_t now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * INT64_C(1000000000) + now.tv_nsec;
}

/* Opens a socket for EtherCAT frames on an interface, with the options of simulator/esc/segment.c.
 * Ends the program if the interface cannot be used. */
static inline int open_raw_socket(const char *interface, long timeout_us)
{
    unsigned index = if_nametoindex(interface);
    int fd = socket(AF_PACKET, SOCK_RAW | SOCK_CLOEXEC, 0);
    if (index == 0 || fd < 0)
        fail(interface);
    int on = 1;
    struct timeval timeout = {timeout_us / 1000000, timeout_us % 1000000};
    struct packet_mreq promiscuous = {.mr_ifindex = (int)index, .mr_type = PACKET_MR_PROMISC};
    struct sockaddr_ll address = {.sll_family = AF_PACKET,
                                  .sll_protocol = htons(ETHERTYPE_ECAT),
                                  .sll_ifindex = (int)index};
    (void)setsockopt(fd, SOL_PACKET, PACKET_IGNORE_OUTGOING, &on, sizeof on);
    (void)setsockopt(fd, SOL_PACKET, PACKET_QDISC_BYPASS, &on, sizeof on);
    if (setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &timeout, sizeof timeout) != 0 ||
        setsockopt(fd, SOL_PACKET, PACKET_ADD_MEMBERSHIP, &promiscuous, sizeof promiscuous) != 0 ||
        bind(fd, (const struct sockaddr *)&address, sizeof address) != 0)
        fail(interface);
    return fd;
}

/* Asks for SCHED_FIFO, or else for short time slices, as the simulator does; returns whether it got
 * SCHED_FIFO. */
static inline bool ask_for_real_time(int priority)
{
    struct sched_param parameter = {.sched_priority = priority};
    struct {
        uint32_t size, policy;
        uint64_t flags;
        int32_t nice;
        uint32_t priority;
        uint64_t runtime, deadline, period;
    } ordinary = {.size = 48, .policy = SCHED_OTHER, .runtime = 100000 /* ns */};
    bool granted = sched_setscheduler(0, SCHED_FIFO, &parameter) == 0;
    if (!granted)
        (void)syscall(SYS_sched_setattr, 0, &ordinary, 0);
    (void)prctl(PR_SET_TIMERSLACK, 1);
    return granted;
}

/* Ends this process when the process that started it ends. */
static inline void die_with_parent(void) { (void)prctl(PR_SET_PDEATHSIG, SIGKILL); }

#endif
