/* Ports, links and loops of the slaves, and the way that frames take through them.
 *
 * A slave passes a frame on from port 0 through its processing unit to port 3, then 1, then 2, then
 * back to 0. A port whose loop is closed is left out, and a closed port 0 leads into the processing
 * unit again. What comes in by another port than 0 therefore leaves by port 0 unprocessed, unless
 * port 0 is closed: that is how both halves of a broken ring are processed.
 */
#include "slave.h"

enum {
    FORWARD_NS = 300, /* from one port of a slave to the next open one, with or without processing */
    LINK_NS = 100,    /* from port to port: the cable and what drives it */
    LOOP_AUTO = 0,    /* loop control, two bits a port in register 0x0101: open while there is a link */
    LOOP_AUTO_CLOSE = 1, /* closes without a link and is opened by the master or by a frame */
    LOOP_OPEN = 2,
    LOOP_CLOSED = 3,
    PORT_EBUS = 2 /* port descriptor: lower values say that there is no port */
};

static const uint8_t next_port[PORTS] = {3, 2, 0, 1};

static bool has_port(const struct slave *slave, unsigned port)
{
    return (slave->memory[REG_PORTS] >> 2 * port & 3) >= PORT_EBUS;
}

static bool link_up(const struct slave *slave, unsigned port)
{
    const struct plug *plug = &slave->plugs[port];
    return plug->kind != PLUG_NONE && !plug->broken;
}

static bool loop_open(const struct slave *slave, unsigned port, bool up)
{
    switch (slave->memory[REG_DL_CONTROL + 1] >> 2 * port & 3) {
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
    registers_set_links(slave, (uint8_t)links, (uint8_t)open);
}

/* A slave whose loops are all closed keeps port 0 open, so that it can be reached to change that;
 * its DL status does not tell. */
static bool is_open(const struct slave *slave, unsigned port)
{
    return (slave->open >> port & 1) != 0 || (slave->open == 0 && port == 0);
}

static void pass_processing_unit(struct route *route, const struct slave *slave)
{
    route->order[route->count++] = (uint16_t)slave->position;
}

/* The frame has arrived at a port that is open. Returns the port by which it leaves the slave. */
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
    for (unsigned i = 0; i < slaves; i++)
        for (unsigned port = 0; port < PORTS; port++)
            route->arrival[i][port] = -1;
}

/* Every step leads to another port, so the way ends. */
static void trace(struct esc_segment *segment, unsigned interface)
{
    struct route *route = &segment->routes[interface];
    struct plug at = segment->interfaces[interface];
    int32_t ns = 0;
    clear(route, segment->count);
    while (at.kind == PLUG_SLAVE && !at.broken) {
        struct slave *slave = segment->slaves[at.number];
        ns += LINK_NS;
        if (!is_open(slave, at.port)) {
            unsigned control = slave->memory[REG_DL_CONTROL + 1] >> 2 * at.port & 3;
            route->woken = control == LOOP_AUTO_CLOSE ? slave : NULL;
            route->woken_port = at.port;
            return;
        }
        route->arrival[at.number][at.port] = ns;
        at = slave->plugs[pass_slave(route, slave, at.port)];
        ns += FORWARD_NS;
    }
    if (at.kind == PLUG_INTERFACE && !at.broken)
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

int64_t topology_arrival(const struct slave *slave, unsigned port)
{
    return slave->segment->route->arrival[slave->position][port];
}

static void plug_slaves(struct slave *slave, struct slave *parent, unsigned port)
{
    slave->plugs[0] = (struct plug){PLUG_SLAVE, parent->position, port, false};
    parent->plugs[port] = (struct plug){PLUG_SLAVE, slave->position, 0, false};
}

/* Where a new slave is without being told: behind port 1 of the one before, the first one at the
 * interface. Where that is impossible it is not connected. */
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
