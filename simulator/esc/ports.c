/* Registers of the ports: DL status (0x0110) and the error counters (0x0300 to 0x0313).
 *
 * Counters stop at 255. A write of any value to a counter clears its group.
 */
#include "slave.h"

enum {
    DL_PDI = 0x0003, /* PDI operational and its watchdog, which live.c sets */
    DL_ENHANCED_LINK_DETECTION = 0x0004,
    DL_LINK = 0x0010,                  /* port 0; the next bits are the other ports */
    DL_LOOP_CLOSED = 0x0100,           /* port 0; two bits a port */
    DL_COMMUNICATION = 0x0200,         /* port 0; two bits a port */
    ENHANCED_LINK_DETECTION = 0xF200,  /* PDI control: all ports, and EBUS ports one by one */
    INVALID_FRAME = 0,                 /* the first of the two bytes a port at 0x0300 */
    PHYSICAL_ERROR = 1                 /* the second one */
};

static void count(uint8_t *counter)
{
    if (*counter < 0xFF)
        ++*counter;
}

/* Called when links or loops may have changed. */
void ports_set(struct slave *slave, uint8_t links, uint8_t open)
{
    uint8_t *memory = slave->memory;
    unsigned status = load16(memory + REG_DL_STATUS) & DL_PDI;
    if ((load16(memory + REG_PDI_CONTROL) & ENHANCED_LINK_DETECTION) != 0)
        status |= DL_ENHANCED_LINK_DETECTION;
    for (unsigned port = 0; port < PORTS; port++) {
        bool up = (links >> port & 1) != 0, is_open = (open >> port & 1) != 0;
        if (up)
            status |= DL_LINK << port;
        if (!is_open)
            status |= DL_LOOP_CLOSED << 2 * port;
        else if (up)
            status |= DL_COMMUNICATION << 2 * port;
        if (!up && (slave->links & slave->open) >> port & 1)
            count(memory + REG_LOST_LINKS + port);
    }
    slave->links = links;
    slave->open = open;
    if (status != load16(memory + REG_DL_STATUS)) {
        store16(memory + REG_DL_STATUS, status);
        registers_set_event(slave, ECAT_EVENT_DL, true);
    }
}

/* Called when the master writes [from, to). Returns whether there are counters in it. */
bool ports_clear_counters(struct slave *slave, uint32_t from, uint32_t to)
{
    static const struct {
        uint16_t address, size;
    } groups[] = {
        {REG_RX_ERRORS, REG_PROCESSING_ERRORS - REG_RX_ERRORS}, /* with the forwarded errors */
        {REG_PROCESSING_ERRORS, 1},
        {REG_PDI_ERRORS, 1},
        {REG_LOST_LINKS, PORTS},
    };
    bool any = false;
    for (unsigned i = 0; i < sizeof groups / sizeof groups[0]; i++)
        if (touches(from, to, groups[i].address, groups[i].size)) {
            memset(slave->memory + groups[i].address, 0, groups[i].size);
            any = true;
        }
    return any;
}

/* Counts a frame with contradicting lengths, at each processing unit that it passes. */
void ports_count_malformed(struct esc_segment *segment)
{
    const struct route *route = segment->route;
    for (unsigned i = 0; i < route->count; i++)
        count(segment->slaves[route->order[i]]->memory + REG_PROCESSING_ERRORS);
}

/* Counts the errors of a frame that was damaged on its way to `at`. That slave sees a wrong check
 * sum and marks the frame; all ports and processing units behind it see the mark. */
void ports_count_noise(struct esc_segment *segment, const struct route *route, struct slave *at)
{
    unsigned first_port = route->first_port[at->position];
    int32_t since = route->arrival[at->position][first_port];
    uint8_t *errors = at->memory + REG_RX_ERRORS + 2 * first_port;
    count(errors + INVALID_FRAME);
    count(errors + PHYSICAL_ERROR);
    for (unsigned i = 0; i < segment->count; i++)
        for (unsigned port = 0; port < PORTS; port++)
            if (route->arrival[i][port] > since)
                count(segment->slaves[i]->memory + REG_FORWARDED_ERRORS + port);
    for (unsigned i = route->before[at->position]; i < route->count; i++)
        count(segment->slaves[route->order[i]]->memory + REG_PROCESSING_ERRORS);
}
