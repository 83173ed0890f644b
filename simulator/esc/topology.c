/* Ports, links and loops of the slaves, and the path of frames through them.
 *
 * A slave passes a frame from port 0 through its processing unit to port 3, then 1, then 2, then
 * back to 0. Ports with a closed loop are left out, and a closed port 0 leads into the processing
 * unit again. A frame that enters through another port than 0 therefore leaves through port 0
 * unprocessed, unless port 0 is closed. This lets both halves of a broken ring process frames.
 */
#include "slave.h"

#include <errno.h>

enum {
    FORWARD_NS = 300, /* from a port of a slave to its next open one, processed or not */
    LINK_NS = 100,    /* from port to port: the cable and its drivers */
    LOOP_AUTO = 0,    /* values of the two bits a port in register 0x0101: open with a link */
    LOOP_AUTO_CLOSE = 1, /* closes without a link and is opened by the master or by a frame */
    LOOP_OPEN = 2,
    LOOP_CLOSED = 3,
    PORT_EBUS = 2 /* port descriptor: lower values mean that there is no port */
};

enum { DL_TEMPORARY = 0x02 }; /* of register 0x0100: the loop control holds for about a second */
static const int64_t TEMPORARY_NS = 1000000000;

static const uint8_t next_port[PORTS] = {3, 2, 0, 1};

static bool has_port(const struct slave *slave, unsigned port)
{
    return (slave->config.ports >> 2 * port & 3) >= PORT_EBUS;
}

/* A link needs both ends: a swapped slave may lack a port that is plugged in. */
static bool link_up(const struct slave *slave, unsigned port)
{
    const struct plug *plug = &slave->plugs[port];
    if (plug->kind == PLUG_NONE || plug->broken || slave->off || !has_port(slave, port))
        return false;
    if (plug->kind == PLUG_INTERFACE)
        return !slave->segment->no_carrier[plug->number];
    const struct slave *peer = slave->segment->slaves[plug->number];
    return !peer->off && has_port(peer, plug->port);
}

static unsigned loop_control(const struct slave *slave, unsigned port)
{
    return slave->memory[REG_DL_CONTROL + 1] >> 2 * port & 3;
}

static bool loop_open(const struct slave *slave, unsigned port, bool up)
{
    switch (loop_control(slave, port)) {
    case LOOP_AUTO_CLOSE:
        return up && (slave->reopen || (slave->open >> port & 1) != 0);
    case LOOP_OPEN:
        return has_port(slave, port);
    case LOOP_CLOSED:
        return false;
    default:
        return up;
    }
}

static void update_slave(struct slave *slave)
{
    unsigned links = 0, open = 0;
    for (unsigned port = 0; port < PORTS; port++) {
        bool up = link_up(slave, port);
        links |= (unsigned)up << port;
        open |= (unsigned)loop_open(slave, port, up) << port;
    }
    slave->reopen = false;
    ports_set(slave, (uint8_t)links, (uint8_t)open);
}

/* Whether the loop of a port is open. A slave whose loops are all closed keeps port 0 open, so that
 * the master can still reach it; its DL status does not show that. */
static bool is_open(const struct slave *slave, unsigned port)
{
    return (slave->open >> port & 1) != 0 || (slave->open == 0 && port == 0);
}

static void pass_processing_unit(struct route *route, const struct slave *slave)
{
    route->order[route->count++] = (uint16_t)slave->position;
}

/* Passes a frame that has arrived at an open port through a slave. Returns the port through which
 * it leaves. */
static unsigned pass_slave(struct route *route, const struct slave *slave, unsigned port)
{
    if (port == 0)
        pass_processing_unit(route, slave);
    for (port = next_port[port]; !is_open(slave, port); port = next_port[port])
        if (port == 0)
            pass_processing_unit(route, slave);
    return port;
}

static void clear(struct route *route, unsigned slaves)
{
    route->exit = LOST;
    route->count = 0;
    route->woken = NULL;
    route->event_word_known = false;
    route->collected = false;
    memset(route->first_port, NO_PORT, slaves);
    for (unsigned i = 0; i < slaves; i++)
        for (unsigned port = 0; port < PORTS; port++)
            route->arrival[i][port] = -1;
}

static void arrive(struct route *route, const struct plug *at, int32_t ns)
{
    route->arrival[at->number][at->port] = ns;
    if (route->first_port[at->number] == NO_PORT) {
        route->first_port[at->number] = (uint8_t)at->port;
        route->before[at->number] = (uint16_t)route->count;
    }
}

/* Finds the path of a frame. It ends: a link leads to one port only, so no port comes twice. */
static void trace(struct esc_segment *segment, unsigned interface)
{
    struct route *route = &segment->routes[interface];
    struct plug at = segment->interfaces[interface];
    int32_t ns = 0;
    clear(route, segment->count);
    while (at.kind == PLUG_SLAVE) {
        struct slave *slave = segment->slaves[at.number];
        if (!link_up(slave, at.port))
            return;
        if (!is_open(slave, at.port)) {
            route->woken = loop_control(slave, at.port) == LOOP_AUTO_CLOSE ? slave : NULL;
            route->woken_port = at.port;
            return;
        }
        ns += LINK_NS;
        arrive(route, &at, ns);
        unsigned port = pass_slave(route, slave, at.port);
        if (!link_up(slave, port)) /* the master opened the loop: the frame is lost */
            return;
        at = slave->plugs[port];
        ns += FORWARD_NS;
    }
    if (at.kind == PLUG_INTERFACE)
        route->exit = (int)at.number;
}

/* Called with the lock held when links or loops may have changed. */
void topology_update(struct esc_segment *segment)
{
    segment->topology_stale = false;
    for (unsigned i = 0; i < segment->count; i++)
        update_slave(segment->slaves[i]);
    for (unsigned i = 0; i < INTERFACES; i++)
        trace(segment, i);
}

void topology_set_loops(struct slave *slave, uint8_t before)
{
    bool temporary = (slave->memory[REG_DL_CONTROL] & DL_TEMPORARY) != 0;
    if (temporary && slave->loops_until_ns == 0)
        slave->loops_before = before; /* else the one before the first temporary one comes back */
    slave->loops_until_ns = temporary ? frame_time_ns(slave->segment) + TEMPORARY_NS : 0;
    slave->segment->temporary_loops |= temporary;
}

void topology_restore_loops(struct esc_segment *segment)
{
    if (!segment->temporary_loops)
        return;
    int64_t now_ns = frame_time_ns(segment);
    segment->temporary_loops = false;
    for (unsigned i = 0; i < segment->count; i++) {
        struct slave *slave = segment->slaves[i];
        if (slave->loops_until_ns == 0 || now_ns < slave->loops_until_ns) {
            segment->temporary_loops |= slave->loops_until_ns != 0;
            continue;
        }
        slave->loops_until_ns = 0;
        slave->memory[REG_DL_CONTROL + 1] = slave->loops_before;
        slave->reopen = true;
        segment->topology_stale = true;
    }
}

/* Applies writes to the loop control that are still pending. Called before links change. */
void topology_refresh(struct esc_segment *segment)
{
    if (segment->topology_stale)
        topology_update(segment);
}

/* Opens the port at which a frame ended because of auto-close, so that the next frame passes. */
void topology_wake(struct esc_segment *segment, const struct route *route)
{
    if (route->woken != NULL) {
        route->woken->open |= (uint8_t)(1U << route->woken_port);
        segment->topology_stale = true;
    }
}

int64_t topology_arrival(const struct slave *slave, unsigned port)
{
    return slave->segment->route->arrival[slave->position][port];
}

static void plug_slaves(struct slave *slave, struct slave *parent, unsigned port)
{
    slave->plugs[0] = (struct plug){PLUG_SLAVE, parent->position, port, false};
    parent->plugs[port] = (struct plug){PLUG_SLAVE, slave->position, 0, false};
}

/* Plugs in a new slave: the first one at the interface, each other one at port 1 of the slave
 * before. If that port does not exist or is taken, the slave is not connected. */
void topology_plug_next(struct slave *slave)
{
    struct esc_segment *segment = slave->segment;
    if (slave->position == 0) {
        slave->plugs[0] = (struct plug){PLUG_INTERFACE, 0, 0, false};
        segment->interfaces[0] = (struct plug){PLUG_SLAVE, 0, 0, false};
        return;
    }
    struct slave *before = segment->slaves[slave->position - 1];
    if (has_port(before, 1) && before->plugs[1].kind == PLUG_NONE)
        plug_slaves(slave, before, 1);
}

static struct slave *find(struct esc_segment *segment, int number)
{
    return number >= 0 && (unsigned)number < segment->count ? segment->slaves[number] : NULL;
}

static int check_free(const struct slave *slave, int port)
{
    if (port < 0 || port >= PORTS || !has_port(slave, (unsigned)port))
        return -ENXIO;
    return slave->plugs[port].kind == PLUG_NONE ? 0 : -EADDRINUSE;
}

static void unplug(struct slave *slave, unsigned port)
{
    struct plug *plug = &slave->plugs[port];
    if (plug->kind == PLUG_SLAVE)
        slave->segment->slaves[plug->number]->plugs[plug->port].kind = PLUG_NONE;
    if (plug->kind == PLUG_INTERFACE)
        slave->segment->interfaces[plug->number].kind = PLUG_NONE;
    plug->kind = PLUG_NONE;
}

/* Whether `slave` is `parent` itself or lies between it and the interface. */
static bool above(const struct slave *slave, const struct slave *parent)
{
    while (parent != slave && parent->plugs[0].kind == PLUG_SLAVE)
        parent = slave->segment->slaves[parent->plugs[0].number];
    return parent == slave;
}

static int connect_slave(struct esc_segment *segment, int number, int above_number, int port)
{
    struct slave *slave = find(segment, number), *parent = find(segment, above_number);
    if (slave == NULL || parent == NULL)
        return -ENODEV;
    if (port == 0 || !has_port(slave, 0))
        return -ENXIO;
    if (above(slave, parent))
        return -ELOOP;
    const struct plug *now = &slave->plugs[0];
    if (now->kind == PLUG_SLAVE && now->number == parent->position && (int)now->port == port)
        return 0;
    int error = check_free(parent, port);
    if (error != 0)
        return error;
    unplug(slave, 0);
    plug_slaves(slave, parent, (unsigned)port);
    topology_update(segment);
    return 0;
}

int esc_connect(struct esc_segment *segment, int slave, int parent, int port)
{
    pthread_mutex_lock(&segment->lock);
    int result = connect_slave(segment, slave, parent, port);
    /* Wiring comes before power-on, so a link that was moved must not count as lost. */
    for (unsigned i = 0; i < segment->count; i++)
        memset(segment->slaves[i]->memory + REG_LOST_LINKS, 0, PORTS);
    pthread_mutex_unlock(&segment->lock);
    return result;
}

/* Tells what is plugged into a port which port that is. */
static void follow_plug(struct slave *slave, unsigned port)
{
    const struct plug *plug = &slave->plugs[port];
    if (plug->kind == PLUG_SLAVE)
        slave->segment->slaves[plug->number]->plugs[plug->port].port = port;
    if (plug->kind == PLUG_INTERFACE)
        slave->segment->interfaces[plug->number].port = port;
}

int esc_exchange_ports(struct esc_segment *segment, int number)
{
    pthread_mutex_lock(&segment->lock);
    struct slave *slave = find(segment, number);
    int result = slave == NULL ? -ENODEV : !has_port(slave, 0) || !has_port(slave, 1) ? -ENXIO : 0;
    if (result == 0) {
        struct plug first = slave->plugs[0];
        slave->plugs[0] = slave->plugs[1];
        slave->plugs[1] = first;
        follow_plug(slave, 0);
        follow_plug(slave, 1);
        topology_update(segment);
        for (unsigned i = 0; i < segment->count; i++) /* as for esc_connect */
            memset(segment->slaves[i]->memory + REG_LOST_LINKS, 0, PORTS);
    }
    pthread_mutex_unlock(&segment->lock);
    return result;
}

int esc_close_ring(struct esc_segment *segment, int number, int port)
{
    pthread_mutex_lock(&segment->lock);
    struct slave *slave = find(segment, number);
    int result = slave == NULL ? -ENODEV : check_free(slave, port);
    if (result == 0) {
        struct plug *before = &segment->interfaces[1];
        if (before->kind == PLUG_SLAVE)
            segment->slaves[before->number]->plugs[before->port].kind = PLUG_NONE;
        *before = (struct plug){PLUG_SLAVE, slave->position, (unsigned)port, false};
        slave->plugs[port] = (struct plug){PLUG_INTERFACE, 1, 0, false};
        topology_update(segment);
    }
    pthread_mutex_unlock(&segment->lock);
    return result;
}

static int break_link(struct esc_segment *segment, int number, int port, bool broken)
{
    struct slave *slave = find(segment, number);
    if (slave == NULL)
        return -ENODEV;
    if (port < 0 || port >= PORTS || slave->plugs[port].kind == PLUG_NONE)
        return -ENOTCONN;
    topology_refresh(segment);
    struct plug *plug = &slave->plugs[port];
    plug->broken = broken;
    if (plug->kind == PLUG_SLAVE)
        segment->slaves[plug->number]->plugs[plug->port].broken = broken;
    topology_update(segment);
    return 0;
}

int esc_break_link(struct esc_segment *segment, int slave, int port, int broken)
{
    pthread_mutex_lock(&segment->lock);
    int result = break_link(segment, slave, port, broken != 0);
    pthread_mutex_unlock(&segment->lock);
    return result;
}

int esc_set_carrier(struct esc_segment *segment, int interface, int carrier)
{
    if (interface < 0 || interface >= INTERFACES)
        return -EINVAL;
    pthread_mutex_lock(&segment->lock);
    topology_refresh(segment);
    segment->no_carrier[interface] = !carrier;
    topology_update(segment);
    pthread_mutex_unlock(&segment->lock);
    return 0;
}

int esc_order(struct esc_segment *segment, int interface, uint16_t *order, int capacity)
{
    if (interface < 0 || interface >= INTERFACES)
        return -EINVAL;
    pthread_mutex_lock(&segment->lock);
    topology_refresh(segment);
    const struct route *route = &segment->routes[interface];
    int count = (int)route->count;
    for (int i = 0; i < count && i < capacity; i++)
        order[i] = route->order[i];
    pthread_mutex_unlock(&segment->lock);
    return count;
}
