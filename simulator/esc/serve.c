/* The thread that serves one interface, or two, with a segment. */
#include "slave.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/if_packet.h>
#include <net/if.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <unistd.h>

enum {
    STOP_POLL_US = 20000,
    PRIORITY = 85, /* above a master on the same machine, which waits for the answer */
    MAX_LATE = 64  /* delayed frames at a time; further ones are lost */
};

struct late_frame {
    int64_t due_ns; /* CLOCK_MONOTONIC; 0 = this place is free */
    size_t size;
    int exit, copies;
    uint8_t data[MAX_FRAME];
};

struct server {
    struct esc_segment *segment;
    pthread_t thread;
    atomic_bool stop;
    int sockets[INTERFACES]; /* -1 = none */
    unsigned late_count;
    struct late_frame late[MAX_LATE];
};

/* Asks for real-time priority, since real slave controllers are hardware and never late. If that is
 * not permitted, the thread competes with all others, and frames may come back late. */
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
    /* Linux (6.12) runs ordinary threads sooner if they ask for short slices. */
    if (pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameter) != 0)
        (void)syscall(SYS_sched_setattr, 0, &ordinary, 0);
    (void)prctl(PR_SET_TIMERSLACK, 1);
}

/* Sends a frame. It is lost if there is no room for it, as on a wire. */
static void send_out(const struct server *server, const uint8_t *frame, size_t size, int exit,
                     int copies)
{
    for (int i = 0; i < copies; i++)
        (void)send(server->sockets[exit], frame, size, MSG_DONTWAIT);
}

static void keep(struct server *server, const uint8_t *frame, size_t size,
                 const struct esc_passage *passage)
{
    struct esc_segment *segment = server->segment;
    for (unsigned i = 0; i < MAX_LATE; i++) {
        struct late_frame *late = &server->late[i];
        if (late->due_ns != 0)
            continue;
        late->due_ns = clock_now_ns() + passage->delay_ns;
        late->size = size;
        late->exit = passage->exit;
        late->copies = passage->copies;
        memcpy(late->data, frame, size);
        server->late_count++;
        return;
    }
    pthread_mutex_lock(&segment->lock); /* no room: the frame is lost */
    segment->counters.frames--;
    segment->counters.dropped++;
    pthread_mutex_unlock(&segment->lock);
}

static struct late_frame *earliest(struct server *server)
{
    struct late_frame *found = NULL;
    for (unsigned i = 0; i < MAX_LATE; i++) {
        struct late_frame *late = &server->late[i];
        if (late->due_ns != 0 && (found == NULL || late->due_ns < found->due_ns))
            found = late;
    }
    return found;
}

/* Sends the frames that are due. Returns the due time of the next one, or 0 if there is none. */
static int64_t send_due(struct server *server)
{
    while (server->late_count > 0) {
        struct late_frame *late = earliest(server);
        if (late->due_ns > clock_now_ns())
            return late->due_ns;
        send_out(server, late->data, late->size, late->exit, late->copies);
        late->due_ns = 0;
        server->late_count--;
    }
    return 0;
}

/* Lets programs take their outputs, now that the answer is on its way. */
static void run_programs(struct esc_segment *segment)
{
    pthread_mutex_lock(&segment->lock);
    program_run_due(segment);
    pthread_mutex_unlock(&segment->lock);
}

/* Receives one frame and answers it. Closes the socket if its interface has vanished. */
static void serve_frame(struct server *server, unsigned interface, int flags)
{
    struct esc_segment *segment = server->segment;
    uint8_t frame[MAX_FRAME];
    struct sockaddr_ll from;
    socklen_t from_size = sizeof from;
    /* MSG_TRUNC makes the result the true size, so that a jumbo frame is recognized. */
    ssize_t size = recvfrom(server->sockets[interface], frame, sizeof frame, MSG_TRUNC | flags,
                            (struct sockaddr *)&from, &from_size);
    if (size < 0) {
        if (errno != EAGAIN && errno != EINTR && errno != ENETDOWN) {
            close(server->sockets[interface]);
            server->sockets[interface] = -1;
        }
        return;
    }
    if ((size_t)size > sizeof frame || from.sll_pkttype == PACKET_OUTGOING)
        return;
    struct esc_passage passage;
    pthread_mutex_lock(&segment->lock);
    segment->frame_ns = 0;
    if (segment->no_carrier[interface]) { /* a frame has come, so there is a carrier */
        segment->no_carrier[interface] = false;
        topology_update(segment);
    }
    frame_process(segment, interface, frame, (size_t)size, &passage);
    bool due = pdi_signal_due(segment), programs_due = segment->programs_due;
    pthread_mutex_unlock(&segment->lock);
    if (passage.exit != LOST && passage.delay_ns > 0)
        keep(server, frame, (size_t)size, &passage);
    else if (passage.exit != LOST)
        send_out(server, frame, (size_t)size, passage.exit, passage.copies);
    if (programs_due)
        run_programs(segment);
    if (due)
        pdi_signal(segment);
}

/* Waits for frames on both interfaces, and for the time to send delayed ones. */
static void wait_and_serve(struct server *server)
{
    struct pollfd sources[INTERFACES];
    struct timespec timeout = {0, STOP_POLL_US * 1000L};
    int64_t next = send_due(server);
    if (next != 0) {
        int64_t left = next - clock_now_ns();
        left = left < 0 ? 0 : left;
        if (left < timeout.tv_nsec)
            timeout.tv_nsec = (long)left;
    }
    for (unsigned i = 0; i < INTERFACES; i++)
        sources[i] = (struct pollfd){.fd = server->sockets[i], .events = POLLIN};
    if (ppoll(sources, INTERFACES, &timeout, NULL) <= 0)
        return;
    for (unsigned i = 0; i < INTERFACES; i++)
        if (sources[i].revents != 0)
            serve_frame(server, i, MSG_DONTWAIT);
}

static bool alive(const struct server *server)
{
    return server->sockets[0] >= 0 || server->sockets[1] >= 0;
}

static void *serve(void *argument)
{
    struct server *server = argument;
    ask_for_real_time();
    while (!atomic_load_explicit(&server->stop, memory_order_relaxed) && alive(server)) {
        if (server->sockets[1] < 0 && server->late_count == 0)
            serve_frame(server, 0, 0); /* saves a system call */
        else
            wait_and_serve(server);
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

static void free_server(struct server *server)
{
    for (unsigned i = 0; i < INTERFACES; i++)
        if (server->sockets[i] >= 0)
            close(server->sockets[i]);
    free(server);
}

static int start_thread(struct server *server)
{
    /* The program's own threads handle signals. */
    sigset_t all, before;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    int error = pthread_create(&server->thread, NULL, serve, server);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    return -error;
}

int esc_start(struct esc_segment *segment, const char *first, const char *second)
{
    if (segment->server != NULL)
        return -EALREADY;
    struct server *server = calloc(1, sizeof *server);
    if (server == NULL)
        return -ENOMEM;
    server->segment = segment;
    server->sockets[1] = -1;
    int result = server->sockets[0] = open_socket(first);
    if (result >= 0 && second != NULL)
        result = server->sockets[1] = open_socket(second);
    if (result >= 0)
        result = start_thread(server);
    if (result < 0) {
        free_server(server);
        return result;
    }
    segment->server = server;
    return 0;
}

int esc_reopen(struct esc_segment *segment, int interface, const char *name)
{
    struct server *server = segment->server;
    if (server == NULL || interface < 0 || interface >= INTERFACES || server->sockets[interface] < 0)
        return -ENOTCONN;
    int fd = open_socket(name);
    if (fd < 0)
        return fd;
    /* The thread keeps using the same descriptor, which refers to the new socket from now on. */
    int result = dup3(fd, server->sockets[interface], O_CLOEXEC) < 0 ? -errno : 0;
    close(fd);
    return result;
}

int esc_stop(struct esc_segment *segment)
{
    struct server *server = segment->server;
    if (server == NULL)
        return 0;
    atomic_store(&server->stop, true);
    pthread_join(server->thread, NULL);
    free_server(server);
    segment->server = NULL;
    return 0;
}
