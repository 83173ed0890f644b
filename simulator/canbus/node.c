/* Nodes: queues, and the error counters of ISO 11898-1 ("Fault confinement"). */
#include "bus.h"

/* Whether it sends, receives and acknowledges. */
bool node_takes_part(const struct node *node) { return node->on && !node->bus_off; }

bool node_passive(const struct node *node)
{
    return node->transmit_errors >= PASSIVE_AT || node->receive_errors >= PASSIVE_AT;
}

enum can_state node_state(const struct node *node)
{
    if (!node->on)
        return CAN_NO_POWER;
    if (node->bus_off)
        return CAN_BUS_OFF;
    if (node_passive(node))
        return CAN_PASSIVE;
    bool warns = node->transmit_errors >= WARNING_AT || node->receive_errors >= WARNING_AT;
    return warns ? CAN_WARNING : CAN_ACTIVE;
}

int64_t node_wants_ns(const struct node *node)
{
    int64_t first = NEVER;
    if (!node_takes_part(node) || (node->flags & CAN_LISTENS_ONLY) != 0)
        return NEVER;
    if (node->transmit.count > 0)
        first = queue_head(&node->transmit)->time_ns;
    for (unsigned i = 0; i < node->source_count; i++) {
        int64_t due = source_due_ns(&node->sources[i]);
        first = due < first ? due : first;
    }
    return first > node->ready_ns ? first : node->ready_ns;
}

/* The queue comes first, and keeps its order. Of the sources that are due, the one whose identifier
 * wins is next, as with the message buffers of a controller. */
struct can_frame node_pick(struct node *node, int64_t now_ns)
{
    struct can_frame frame = {.id = 0};
    uint32_t best = UINT32_MAX;
    node->picked = -1;
    if (node->transmit.count > 0 && queue_head(&node->transmit)->time_ns <= now_ns)
        return *queue_head(&node->transmit);
    for (unsigned i = 0; i < node->source_count; i++) {
        if (source_due_ns(&node->sources[i]) > now_ns)
            continue;
        struct can_frame next = source_frame(&node->sources[i]);
        uint32_t rank = bits_rank(&next);
        if (node->picked >= 0 && rank >= best)
            continue;
        best = rank;
        frame = next;
        node->picked = (int)i;
    }
    return frame;
}

void node_sent(struct node *node, const struct can_frame *frame)
{
    if (node->transmit_errors > 0)
        node->transmit_errors--;
    node->counters.sent++;
    if (node->picked >= 0) {
        node->sources[node->picked].sent++;
        return;
    }
    node->counters.last_tag = frame->tag;
    queue_pop(&node->transmit);
    node->cancelled = false;
}

/* Its frame was not sent. It stays, and is sent again, unless it was taken back in the meantime. */
void node_keep(struct node *node)
{
    if (!node->cancelled)
        return;
    queue_pop(&node->transmit);
    node->counters.dropped++;
    node->cancelled = false;
}

/* An error has ended its attempt. */
void node_send_failed(struct node *node)
{
    node->counters.failed++;
    node->transmit_errors += 8;
    if (node->transmit_errors < BUS_OFF_AT)
        return;
    node->bus_off = true;
    node->idles = 0;
    node->counters.bus_offs++;
}

void node_receive_failed(struct node *node, unsigned by)
{
    node->receive_errors += by;
    if (node->receive_errors > PASSIVE_AT)
        node->receive_errors = PASSIVE_AT; /* it counts no further, as in most controllers */
}

static bool passes(const struct node *node, const struct can_frame *frame)
{
    for (unsigned i = 0; i < node->filter_count; i++) {
        const struct can_filter *filter = &node->filters[i];
        uint32_t kind = (frame->flags & CAN_EXTENDED) != 0 ? CAN_EXTENDED_ONLY : CAN_STANDARD_ONLY;
        if (frame->id >= filter->first && frame->id <= filter->last &&
            (filter->kind == kind || filter->kind == CAN_BOTH))
            return true;
    }
    return node->filter_count == 0;
}

/* Takes a frame that has come without error. */
void node_deliver(struct can_bus *bus, struct node *node, const struct can_frame *frame)
{
    if (node->receive_errors >= PASSIVE_AT)
        node->receive_errors = PASSIVE_AT - 9; /* the standard: between 119 and 127 */
    else if (node->receive_errors > 0)
        node->receive_errors--;
    if (!passes(node, frame))
        return;
    node->counters.received++;
    for (unsigned i = 0; i < node->check_count; i++)
        check_frame(&node->checks[i], frame);
    if (node->echo != 0 && (frame->flags & CAN_REMOTE) == 0) {
        struct can_frame back = *frame;
        back.id ^= node->echo;
        bus_push(bus, node, &back);
    }
    if (node->receive.capacity == 0)
        return; /* nobody takes what it receives */
    if (!queue_push(&node->receive, frame))
        node->counters.overflowed++;
    else if (node->waiting > 0)
        pthread_cond_broadcast(&bus->received);
}

/* Empties the transmit queue. Only the frame on the wire stays, until its attempt has ended. */
void node_cancel(struct can_bus *bus, struct node *node)
{
    const struct attempt *attempt = &bus->attempt;
    uint32_t me = bit_of((unsigned)(node - bus->nodes));
    bool on_wire = attempt->under_way && (attempt->senders & me) != 0 && node->picked < 0;
    unsigned kept = on_wire && node->transmit.count > 0;
    node->counters.dropped += node->transmit.count - kept;
    node->transmit.count = kept;
    node->cancelled = kept > 0;
}

/* Begins as at power-on, and takes part from `ready_ns` on. */
void node_reset(struct node *node, int64_t ready_ns)
{
    node->transmit.count = 0;
    node->receive.count = 0;
    node->counters = (struct can_node_status){.sent = 0};
    node->bus_off = false;
    node->transmit_errors = node->receive_errors = 0;
    node->ready_ns = ready_ns;
}
