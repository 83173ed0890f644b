/* Life of a segment, and the thread that serves an interface with it. */
#include "slave.h"

#include <arpa/inet.h>
#include <errno.h>
#include <linux/if_packet.h>
#include <net/if.h>
#include <sched.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/eventfd.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <unistd.h>

enum {
    ETHERTYPE_ECAT = 0x88A4,
    MAX_FRAME = 2048,
    STOP_POLL_US = 20000,
    PRIORITY = 85 /* above that of a master on the same machine, which waits for the answer */
};

struct esc_segment *esc_create(void)
{
    struct esc_segment *segment = calloc(1, sizeof *segment);
    if (segment == NULL)
        return NULL;
    pthread_mutexattr_t attributes;
    pthread_mutexattr_init(&attributes);
    /* Whoever of the device side holds the lock runs at once when the frame thread wants it. */
    pthread_mutexattr_setprotocol(&attributes, PTHREAD_PRIO_INHERIT);
    pthread_mutex_init(&segment->lock, &attributes);
    pthread_mutexattr_destroy(&attributes);
    segment->socket = -1;
    segment->route = &segment->routes[0];
    topology_update(segment);
    segment->notify = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    if (segment->notify < 0) {
        pthread_mutex_destroy(&segment->lock);
        free(segment);
        return NULL;
    }
    return segment;
}

static void free_slave(struct slave *slave)
{
    if (slave == NULL)
        return;
    free(slave->eeprom.image);
    free(slave->buffers);
    free(slave);
}

void esc_destroy(struct esc_segment *segment)
{
    esc_stop(segment);
    for (unsigned i = 0; i < segment->count; i++) {
        free_slave(segment->slaves[i]);
    }
    close(segment->notify);
    pthread_mutex_destroy(&segment->lock);
    free(segment);
}

int esc_add_slave(struct esc_segment *segment, const struct esc_config *config, const uint8_t *sii,
                  size_t sii_size)
{
    if (config->fmmus > ESC_MAX_CHANNELS || config->sync_managers > ESC_MAX_CHANNELS ||
        config->ram_kib > 60 || (config->eeprom_bytes != 4 && config->eeprom_bytes != 8))
        return -EINVAL;
    if (segment->count >= ESC_MAX_SLAVES)
        return -ENOSPC;
    struct slave *slave = calloc(1, sizeof *slave);
    if (slave == NULL)
        return -ENOMEM;
    slave->eeprom.image = malloc(sii_size + 1); /* never 0 bytes */
    slave->buffers = calloc(1, sizeof *slave->buffers);
    if (slave->eeprom.image == NULL || slave->buffers == NULL) {
        free_slave(slave);
        return -ENOMEM;
    }
    memcpy(slave->eeprom.image, sii, sii_size);
    slave->eeprom.size = sii_size;
    slave->segment = segment;
    slave->config = *config;
    slave->sync_managers = config->sync_managers;
    slave->fmmus = config->fmmus;
    slave->ram_end = REG_RAM + 1024U * config->ram_kib;
    pthread_mutex_lock(&segment->lock);
    slave->position = segment->count;
    segment->slaves[segment->count++] = slave;
    registers_power_on(slave);
    topology_plug_next(slave);
    topology_update(segment);
    pthread_mutex_unlock(&segment->lock);
    return (int)slave->position;
}

int esc_process(struct esc_segment *segment, uint8_t *frame, size_t size)
{
    pthread_mutex_lock(&segment->lock);
    bool answered = frame_process(segment, 0, frame, size) != LOST;
    bool due = pdi_signal_due(segment);
    pthread_mutex_unlock(&segment->lock);
    if (due)
        pdi_signal(segment);
    return answered;
}

/* Slave controllers are hardware: nothing on their side of the wire makes them late. Where real time
 * is not permitted the thread competes with the rest of the machine, and frames may come back late. */
static void ask_for_real_time(void)
{
    struct sched_param parameter = {.sched_priority = PRIORITY};
    struct {
        uint32_t size, policy;
        uint64_t flags;
        int32_t nice;
        uint32_t priority;
        uint64_t runtime, deadline, period;
    } ordinary = {.size = 48, .policy = SCHED_OTHER, .runtime = 100000 /* ns */};
    /* Among ordinary threads, those that ask for short slices are run sooner (Linux 6.12). */
    if (pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameter) != 0)
        (void)syscall(SYS_sched_setattr, 0, &ordinary, 0);
    (void)prctl(PR_SET_TIMERSLACK, 1);
}

static void *serve(void *argument)
{
    struct esc_segment *segment = argument;
    uint8_t frame[MAX_FRAME];
    ask_for_real_time();
    while (!atomic_load_explicit(&segment->stop, memory_order_relaxed)) {
        struct sockaddr_ll from;
        socklen_t from_size = sizeof from;
        /* MSG_TRUNC makes the result the true size, so that a jumbo frame is seen as one. */
        ssize_t size = recvfrom(segment->socket, frame, sizeof frame, MSG_TRUNC,
                                (struct sockaddr *)&from, &from_size);
        if (size < 0) {
            if (errno != EAGAIN && errno != EINTR && errno != ENETDOWN)
                break;
            continue;
        }
        if ((size_t)size > sizeof frame || from.sll_pkttype == PACKET_OUTGOING)
            continue;
        pthread_mutex_lock(&segment->lock);
        bool answered = frame_process(segment, 0, frame, (size_t)size) != LOST;
        bool due = pdi_signal_due(segment);
        pthread_mutex_unlock(&segment->lock);
        /* A frame that finds no room is lost, as on a wire. */
        if (answered)
            (void)send(segment->socket, frame, (size_t)size, MSG_DONTWAIT);
        if (due)
            pdi_signal(segment);
    }
    return NULL;
}

static int open_socket(const char *interface)
{
    unsigned index = if_nametoindex(interface);
    if (index == 0)
        return -errno;
    int fd = socket(AF_PACKET, SOCK_RAW | SOCK_CLOEXEC, 0);
    if (fd < 0)
        return -errno;
    int on = 1;
    struct timeval poll_time = {0, STOP_POLL_US};
    struct packet_mreq promiscuous = {.mr_ifindex = (int)index, .mr_type = PACKET_MR_PROMISC};
    struct sockaddr_ll address = {.sll_family = AF_PACKET,
                                  .sll_protocol = htons(ETHERTYPE_ECAT),
                                  .sll_ifindex = (int)index};
    /* The first two save time and are not known to every kernel. */
    (void)setsockopt(fd, SOL_PACKET, PACKET_IGNORE_OUTGOING, &on, sizeof on);
    (void)setsockopt(fd, SOL_PACKET, PACKET_QDISC_BYPASS, &on, sizeof on);
    if (setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &poll_time, sizeof poll_time) != 0 ||
        setsockopt(fd, SOL_PACKET, PACKET_ADD_MEMBERSHIP, &promiscuous, sizeof promiscuous) != 0 ||
        bind(fd, (const struct sockaddr *)&address, sizeof address) != 0) {
        int error = errno;
        close(fd);
        return -error;
    }
    return fd;
}

int esc_start(struct esc_segment *segment, const char *interface)
{
    if (segment->running)
        return -EALREADY;
    int fd = open_socket(interface);
    if (fd < 0)
        return fd;
    segment->socket = fd;
    atomic_store(&segment->stop, false);
    /* Signals belong to the program's own threads. */
    sigset_t all, before;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    int error = pthread_create(&segment->thread, NULL, serve, segment);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    if (error != 0) {
        close(fd);
        segment->socket = -1;
        return -error;
    }
    segment->running = true;
    return 0;
}

int esc_stop(struct esc_segment *segment)
{
    if (!segment->running)
        return 0;
    atomic_store(&segment->stop, true);
    pthread_join(segment->thread, NULL);
    close(segment->socket);
    segment->socket = -1;
    segment->running = false;
    return 0;
}

void esc_drop(struct esc_segment *segment, uint32_t count)
{
    pthread_mutex_lock(&segment->lock);
    segment->drop = count;
    pthread_mutex_unlock(&segment->lock);
}

void esc_get_counters(struct esc_segment *segment, struct esc_counters *counters)
{
    pthread_mutex_lock(&segment->lock);
    *counters = segment->counters;
    pthread_mutex_unlock(&segment->lock);
}
