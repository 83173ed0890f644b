/* The bus: how time passes, and the calls of `can.h` that concern nodes. */
#include "bus.h"

#include <time.h>

/* After a pause of its caller (a stopped process) the bus lives through this much of it. */
#define MAX_PAUSE_NS INT64_C(1000000000)

static int make_lock(struct can_bus *bus)
{
    pthread_mutexattr_t mutex;
    pthread_condattr_t condition;
    pthread_mutexattr_init(&mutex);
    pthread_mutexattr_setprotocol(&mutex, PTHREAD_PRIO_INHERIT); /* a thread with real time calls */
    pthread_condattr_init(&condition);
    pthread_condattr_setclock(&condition, CLOCK_MONOTONIC);
    int error = pthread_mutex_init(&bus->lock, &mutex);
    if (error == 0)
        error = pthread_cond_init(&bus->received, &condition);
    pthread_mutexattr_destroy(&mutex);
    pthread_condattr_destroy(&condition);
    return error;
}

struct can_bus *can_create(int64_t now_ns)
{
    struct can_bus *bus = calloc(1, sizeof *bus);
    if (bus == NULL)
        return NULL;
    if (make_lock(bus) != 0) {
        free(bus);
        return NULL;
    }
    bus->now_ns = bus->free_ns = now_ns;
    bus->counters.now_ns = now_ns;
    bus->random = 1;
    return bus;
}

void can_destroy(struct can_bus *bus)
{
    for (unsigned i = 0; i < bus->count; i++) {
        free(bus->nodes[i].transmit.frames);
        free(bus->nodes[i].receive.frames);
    }
    pthread_cond_destroy(&bus->received);
    pthread_mutex_destroy(&bus->lock);
    free(bus);
}

/* --- time ------------------------------------------------------------------------------------- */

/* Returns when a node in bus-off has seen enough recessive bits of an idle wire. */
static int64_t recovery_ns(const struct can_bus *bus, const struct node *node)
{
    if (!node->on || !node->bus_off || (node->flags & CAN_STAYS_OFF) != 0)
        return NEVER;
    int64_t left = node->idles >= RECOVERY_IDLES ? 0 : RECOVERY_IDLES - node->idles;
    return bus->free_ns + bits_ns(left * IDLE_BITS, node->bit_rate);
}

static void recover(struct node *node, int64_t now_ns)
{
    node->bus_off = false;
    node->transmit_errors = node->receive_errors = 0;
    node->ready_ns = now_ns;
}

/* The wire was idle until `now_ns`: nodes in bus-off count what they have seen of it. */
static void count_idle(struct can_bus *bus, int64_t now_ns)
{
    for (unsigned i = 0; i < bus->count; i++) {
        struct node *node = &bus->nodes[i];
        if (node->bus_off)
            node->idles += (unsigned)((now_ns - bus->free_ns) / bits_ns(IDLE_BITS, node->bit_rate));
    }
}

/* Finds what happens next on an idle wire: a frame begins, or (`*node`) a node is back. */
static int64_t next_event(struct can_bus *bus, struct node **back)
{
    int64_t first = NEVER;
    *back = NULL;
    for (unsigned i = 0; i < bus->count; i++) {
        struct node *node = &bus->nodes[i];
        int64_t wants = node_wants_ns(node), recovers = recovery_ns(bus, node);
        wants = wants < bus->free_ns ? bus->free_ns : wants;
        if (recovers <= wants && recovers < first) {
            first = recovers;
            *back = node;
        } else if (wants < first) {
            first = wants;
            *back = NULL;
        }
    }
    return first;
}

/* Returns the time of the bus for a time of the caller's clock. */
static int64_t bus_time(struct can_bus *bus, int64_t now_ns)
{
    int64_t now = now_ns - bus->lag_ns;
    if (now - bus->now_ns > MAX_PAUSE_NS) {
        bus->lag_ns += now - bus->now_ns - MAX_PAUSE_NS;
        now = bus->now_ns + MAX_PAUSE_NS;
    }
    return now > bus->now_ns ? now : bus->now_ns;
}

void bus_advance(struct can_bus *bus, int64_t now_ns)
{
    int64_t until = bus_time(bus, now_ns);
    struct node *back = NULL;
    for (;;) {
        if (bus->attempt.under_way) {
            if (bus->attempt.end_ns > until)
                break;
            bus->now_ns = bus->attempt.end_ns;
            attempt_end(bus);
            continue;
        }
        int64_t next = bus->stuck == CAN_DOMINANT ? NEVER : next_event(bus, &back);
        if (next >= until) /* others may still begin at the same time */
            break;
        bus->now_ns = next > bus->now_ns ? next : bus->now_ns;
        if (back != NULL) {
            recover(back, next);
            continue;
        }
        count_idle(bus, next);
        bus->free_ns = next;
        attempt_begin(bus, next);
    }
    bus->now_ns = until;
}

/* --- calls ------------------------------------------------------------------------------------ */

struct node *bus_enter(struct can_bus *bus, int number)
{
    pthread_mutex_lock(&bus->lock);
    if (number >= 0 && (unsigned)number < bus->count)
        return &bus->nodes[number];
    pthread_mutex_unlock(&bus->lock);
    return NULL;
}

void bus_leave(struct can_bus *bus) { pthread_mutex_unlock(&bus->lock); }

static struct node *enter_at(struct can_bus *bus, int number, int64_t now_ns)
{
    struct node *node = bus_enter(bus, number);
    if (node != NULL)
        bus_advance(bus, now_ns);
    return node;
}

int can_add_node(struct can_bus *bus, const struct can_node_config *config)
{
    int result = -ENOSPC;
    if (config->bit_rate == 0 || config->transmit_queue == 0)
        return -EINVAL;
    pthread_mutex_lock(&bus->lock);
    if (bus->count < CAN_MAX_NODES) {
        struct node *node = &bus->nodes[bus->count];
        node->bit_rate = config->bit_rate;
        node->flags = config->flags;
        result = queue_make(&node->transmit, config->transmit_queue);
        if (result == 0 && config->receive_queue > 0)
            result = queue_make(&node->receive, config->receive_queue);
        if (result == 0)
            result = (int)bus->count++;
        else
            free(node->transmit.frames);
    }
    pthread_mutex_unlock(&bus->lock);
    return result;
}

/* A node has vanished or has changed in the middle of a frame. */
static void disturb(struct can_bus *bus, const struct node *node)
{
    struct attempt *attempt = &bus->attempt;
    if (attempt->under_way && (attempt->senders & bit_of((unsigned)(node - bus->nodes))) != 0) {
        attempt->outcome = DESTROYED;
        attempt->senders &= ~bit_of((unsigned)(node - bus->nodes));
    }
}

int can_power(struct can_bus *bus, int number, int on, int64_t now_ns)
{
    struct node *node = enter_at(bus, number, now_ns);
    if (node == NULL)
        return -ENODEV;
    if (node->on != (on != 0)) {
        disturb(bus, node);
        node->on = on != 0;
        node_reset(node, bus->now_ns + bits_ns(IDLE_BITS, node->bit_rate));
    }
    bus_leave(bus);
    return 0;
}

int can_configure(struct can_bus *bus, int number, uint32_t bit_rate, uint32_t flags, int64_t now_ns)
{
    if (bit_rate == 0)
        return -EINVAL;
    struct node *node = enter_at(bus, number, now_ns);
    if (node == NULL)
        return -ENODEV;
    if (node->bit_rate != bit_rate || node->flags != flags)
        disturb(bus, node);
    node->bit_rate = bit_rate;
    node->flags = flags;
    bus_leave(bus);
    return 0;
}

int can_set_queues(struct can_bus *bus, int number, unsigned transmit, unsigned receive,
                   int64_t now_ns)
{
    struct queue queues[2] = {{.frames = NULL}, {.frames = NULL}};
    if (transmit == 0 || receive == 0)
        return -EINVAL;
    int result = queue_make(&queues[0], transmit);
    if (result == 0)
        result = queue_make(&queues[1], receive);
    struct node *node = result == 0 ? enter_at(bus, number, now_ns) : NULL;
    if (node != NULL) {
        disturb(bus, node);
        struct queue before[2] = {node->transmit, node->receive};
        node->counters.dropped += node->transmit.count + node->receive.count;
        node->cancelled = false;
        node->transmit = queues[0];
        node->receive = queues[1];
        memcpy(queues, before, sizeof queues);
        bus_leave(bus);
    } else if (result == 0) {
        result = -ENODEV;
    }
    free(queues[0].frames);
    free(queues[1].frames);
    return result;
}

int can_set_filters(struct can_bus *bus, int number, const struct can_filter *filters,
                    unsigned count)
{
    if (count > CAN_MAX_FILTERS)
        return -EINVAL;
    struct node *node = bus_enter(bus, number);
    if (node == NULL)
        return -ENODEV;
    if (count > 0)
        memcpy(node->filters, filters, count * sizeof *filters);
    node->filter_count = count;
    bus_leave(bus);
    return 0;
}

int64_t can_advance(struct can_bus *bus, int64_t now_ns)
{
    int64_t result = 0;
    pthread_mutex_lock(&bus->lock);
    bus_advance(bus, now_ns);
    for (unsigned i = 0; i < bus->count; i++)
        if (bus->nodes[i].receive.count > 0)
            result |= (int64_t)1 << i;
    pthread_mutex_unlock(&bus->lock);
    return result;
}

/* Puts a frame into the transmit queue now. Returns whether it had room. */
int bus_push(const struct can_bus *bus, struct node *node, const struct can_frame *frame)
{
    struct can_frame mine = *frame;
    mine.time_ns = bus->now_ns;
    if (queue_push(&node->transmit, &mine))
        return 1;
    node->counters.refused++;
    return 0;
}

int can_send(struct can_bus *bus, int number, const struct can_frame *frames, unsigned count,
             int64_t now_ns)
{
    for (unsigned i = 0; i < count; i++)
        if (frames[i].length > sizeof frames[i].data)
            return -EINVAL;
    struct node *node = enter_at(bus, number, now_ns);
    if (node == NULL)
        return -ENODEV;
    int sent = 0;
    for (unsigned i = 0; i < count && node->on; i++)
        sent += bus_push(bus, node, &frames[i]);
    bus_leave(bus);
    return sent;
}

int can_receive(struct can_bus *bus, int number, struct can_frame *frames, unsigned capacity,
                int64_t now_ns)
{
    struct node *node = enter_at(bus, number, now_ns);
    if (node == NULL)
        return -ENODEV;
    unsigned count = 0;
    for (; count < capacity && node->receive.count > 0; count++) {
        frames[count] = *queue_head(&node->receive);
        queue_pop(&node->receive);
    }
    bus_leave(bus);
    return (int)count;
}

int can_wait(struct can_bus *bus, int number, int64_t timeout_ns)
{
    struct timespec until;
    clock_gettime(CLOCK_MONOTONIC, &until);
    int64_t nanoseconds = until.tv_nsec + timeout_ns % 1000000000;
    until.tv_sec += (time_t)(timeout_ns / 1000000000 + nanoseconds / 1000000000);
    until.tv_nsec = (long)(nanoseconds % 1000000000);
    struct node *node = bus_enter(bus, number);
    if (node == NULL)
        return -ENODEV;
    node->waiting++;
    while (node->receive.count == 0)
        if (pthread_cond_timedwait(&bus->received, &bus->lock, &until) != 0)
            break;
    node->waiting--;
    int result = node->receive.count > 0;
    bus_leave(bus);
    return result;
}

int can_cancel(struct can_bus *bus, int number, int64_t now_ns)
{
    struct node *node = enter_at(bus, number, now_ns);
    if (node == NULL)
        return -ENODEV;
    node_cancel(bus, node);
    bus_leave(bus);
    return 0;
}

int can_node_status(struct can_bus *bus, int number, struct can_node_status *status, int64_t now_ns)
{
    struct node *node = enter_at(bus, number, now_ns);
    if (node == NULL)
        return -ENODEV;
    *status = node->counters;
    status->state = node_state(node);
    status->transmit_errors = node->transmit_errors;
    status->receive_errors = node->receive_errors;
    status->transmit_pending = node->transmit.count;
    status->receive_pending = node->receive.count;
    bus_leave(bus);
    return 0;
}

int can_bus_status(struct can_bus *bus, struct can_bus_status *status, int64_t now_ns)
{
    pthread_mutex_lock(&bus->lock);
    bus_advance(bus, now_ns);
    *status = bus->counters;
    status->now_ns = bus->now_ns;
    pthread_mutex_unlock(&bus->lock);
    return 0;
}

/* --- faults ----------------------------------------------------------------------------------- */

int can_restart(struct can_bus *bus, int number, int64_t now_ns)
{
    struct node *node = enter_at(bus, number, now_ns);
    if (node == NULL)
        return -ENODEV;
    if (node->bus_off) {
        int64_t from = bus->free_ns > bus->now_ns ? bus->free_ns : bus->now_ns;
        recover(node, from + bits_ns(RECOVERY_IDLES * IDLE_BITS, node->bit_rate));
    }
    bus_leave(bus);
    return 0;
}

int can_force_bus_off(struct can_bus *bus, int number, int64_t now_ns)
{
    struct node *node = enter_at(bus, number, now_ns);
    if (node == NULL)
        return -ENODEV;
    if (node_takes_part(node)) {
        disturb(bus, node);
        node->transmit_errors = BUS_OFF_AT;
        node_send_failed(node);
    }
    bus_leave(bus);
    return 0;
}

int can_set_noise(struct can_bus *bus, double probability, uint64_t seed, int64_t now_ns)
{
    if (!(probability >= 0 && probability <= 1))
        return -EINVAL;
    pthread_mutex_lock(&bus->lock);
    bus_advance(bus, now_ns);
    bus->noise = probability;
    bus->random = seed != 0 ? seed : 1;
    pthread_mutex_unlock(&bus->lock);
    return 0;
}

/* A wire that is dominant throughout destroys the frame on it, and none can begin. Each node counts
 * errors until it is passive. */
static void hold_dominant(struct can_bus *bus)
{
    if (bus->attempt.under_way)
        bus->attempt.outcome = DESTROYED;
    for (unsigned i = 0; i < bus->count; i++)
        if (node_takes_part(&bus->nodes[i]))
            node_receive_failed(&bus->nodes[i], PASSIVE_AT);
}

int can_set_stuck(struct can_bus *bus, int stuck, int64_t now_ns)
{
    if (stuck < CAN_NOT_STUCK || stuck > CAN_DOMINANT)
        return -EINVAL;
    pthread_mutex_lock(&bus->lock);
    bus_advance(bus, now_ns);
    if (bus->stuck == CAN_DOMINANT && bus->free_ns < bus->now_ns)
        bus->free_ns = bus->now_ns; /* the wire was not idle until now */
    bus->stuck = (enum can_stuck)stuck;
    if (stuck == CAN_DOMINANT)
        hold_dominant(bus);
    else if (stuck == CAN_RECESSIVE && bus->attempt.under_way)
        bus->attempt.outcome = DESTROYED;
    pthread_mutex_unlock(&bus->lock);
    return 0;
}
