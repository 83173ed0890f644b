/* An attempt to send a frame: arbitration, acknowledgement, errors, and how long it takes.
 *
 * What happens is decided when it begins, and takes effect when it ends. Delays on the wire are not
 * simulated: all nodes see a bit at the same time.
 */
#include "bus.h"

enum {
    ACK_SLOT = 2,       /* bits from the CRC to the end of the slot */
    END_OF_FRAME = 8,   /* delimiter of the slot, end of frame */
    ERROR_FLAG = 6,
    ERROR_DELIMITER = 8,
    SUSPENDED = 8,      /* bits for which a passive sender lets others go first */
    NONSENSE_AFTER = 10 /* bits after which a node with another bit rate has seen an error */
};

/* Returns a random number from 0 to 1 (xorshift64*). */
static double random_number(struct can_bus *bus)
{
    bus->random ^= bus->random >> 12;
    bus->random ^= bus->random << 25;
    bus->random ^= bus->random >> 27;
    return (double)(bus->random * UINT64_C(2685821657736338717) >> 11) / 9007199254740992.0;
}

/* Compares the bits behind the arbitration field: below 0 if those of `one` are dominant first. */
static int compare_rest(const struct can_frame *one, const struct can_frame *other)
{
    if (one->length != other->length)
        return one->length < other->length ? -1 : 1;
    return memcmp(one->data, other->data, one->length);
}

/* What the nodes that begin at the same time make of it. */
struct contest {
    uint32_t winners, equals; /* equals: lost by data, behind the same identifier */
    uint32_t contestants;
    bool mixed; /* their bit rates are not the same */
    uint32_t rank, bit_rate;
    struct can_frame frame;
};

static void enter_contest(struct contest *contest, unsigned number, uint32_t bit_rate,
                          const struct can_frame *frame)
{
    uint32_t rank = bits_rank(frame);
    int order = rank < contest->rank ? -1 : rank > contest->rank;
    if (contest->contestants == 0)
        order = -1;
    else
        contest->mixed |= bit_rate != contest->bit_rate;
    contest->contestants |= bit_of(number);
    if (order < 0) {
        contest->equals = 0;
    } else if (order == 0) {
        order = compare_rest(frame, &contest->frame);
        contest->equals |= order < 0 ? contest->winners : order > 0 ? bit_of(number) : 0;
    }
    if (order > 0)
        return;
    contest->winners = order < 0 ? bit_of(number) : contest->winners | bit_of(number);
    contest->rank = rank;
    contest->bit_rate = bit_rate;
    contest->frame = *frame;
    contest->frame.sender = (uint8_t)number;
}

static struct contest arbitrate(struct can_bus *bus, int64_t now_ns)
{
    struct contest contest = {.winners = 0};
    for (unsigned i = 0; i < bus->count; i++) {
        struct node *node = &bus->nodes[i];
        if (node_wants_ns(node) > now_ns)
            continue;
        struct can_frame frame = node_pick(node, now_ns);
        enter_contest(&contest, i, node->bit_rate, &frame);
    }
    return contest;
}

static void set_end(struct attempt *attempt, uint32_t bit_rate, int64_t to_end, int64_t to_free)
{
    attempt->end_ns = attempt->begin_ns + bits_ns(to_end, bit_rate);
    attempt->free_ns = attempt->begin_ns + bits_ns(to_free, bit_rate);
}

/* An error frame follows `bits` bits. `echoed`: other nodes answer its flag with theirs. */
static void destroy(struct attempt *attempt, uint32_t bit_rate, unsigned bits, bool echoed)
{
    unsigned flags = ERROR_FLAG * (echoed ? 2 : 1);
    attempt->outcome = DESTROYED;
    set_end(attempt, bit_rate, bits + flags, bits + flags + ERROR_DELIMITER + INTERMISSION_BITS);
}

static bool is_acknowledged(const struct can_bus *bus, const struct contest *contest)
{
    for (unsigned i = 0; i < bus->count; i++) {
        const struct node *node = &bus->nodes[i];
        if (node_takes_part(node) && node->bit_rate == contest->bit_rate &&
            (node->flags & CAN_LISTENS_ONLY) == 0 && (contest->winners & bit_of(i)) == 0)
            return true;
    }
    return false;
}

/* Notes the nodes that listen with another bit rate. Returns whether one of them is not passive: its
 * error flag then destroys the frame. */
static bool find_disturbed(const struct can_bus *bus, struct attempt *attempt, uint32_t bit_rate)
{
    bool any = false;
    for (unsigned i = 0; i < bus->count; i++) {
        const struct node *node = &bus->nodes[i];
        if (!node_takes_part(node) || node->bit_rate == bit_rate)
            continue;
        attempt->disturbed |= bit_of(i);
        any |= !node_passive(node) && (node->flags & CAN_LISTENS_ONLY) == 0;
    }
    return any;
}

static bool any_active(const struct can_bus *bus, uint32_t nodes)
{
    for (unsigned i = 0; i < bus->count; i++)
        if ((nodes & bit_of(i)) != 0 && !node_passive(&bus->nodes[i]))
            return true;
    return false;
}

/* Those that have lost behind the identifier have sent a recessive bit and seen a dominant one: an
 * error. If one of them is not passive, its flag ends the frame for all. */
static bool collides(struct can_bus *bus, struct contest *contest)
{
    if (contest->equals == 0)
        return false;
    if (any_active(bus, contest->equals)) {
        contest->winners |= contest->equals;
        return true;
    }
    for (unsigned i = 0; i < bus->count; i++)
        if ((contest->equals & bit_of(i)) != 0)
            node_send_failed(&bus->nodes[i]);
    return false;
}

void attempt_begin(struct can_bus *bus, int64_t now_ns)
{
    struct contest contest = arbitrate(bus, now_ns);
    bool collided = collides(bus, &contest);
    unsigned to_crc = bits_to_crc(&contest.frame);
    struct attempt *attempt = &bus->attempt;
    *attempt = (struct attempt){.under_way = true, .begin_ns = now_ns, .frame = contest.frame};
    if (contest.mixed)
        contest.winners = contest.contestants;
    attempt->senders = contest.winners;
    bool nonsense = find_disturbed(bus, attempt, contest.bit_rate);
    attempt->disturbed &= ~attempt->senders;
    if (bus->stuck == CAN_RECESSIVE)
        destroy(attempt, contest.bit_rate, 1, false);
    else if (contest.mixed || nonsense)
        destroy(attempt, contest.bit_rate, NONSENSE_AFTER, true);
    else if (collided)
        destroy(attempt, contest.bit_rate, to_crc / 2, true);
    else if (bus->noise > 0 && random_number(bus) < bus->noise)
        destroy(attempt, contest.bit_rate, 1 + (unsigned)(random_number(bus) * to_crc), true);
    else if (!is_acknowledged(bus, &contest)) {
        destroy(attempt, contest.bit_rate, to_crc + ACK_SLOT, false);
        attempt->outcome = NOT_ACKNOWLEDGED;
    } else {
        unsigned bits = to_crc + ACK_SLOT + END_OF_FRAME;
        set_end(attempt, contest.bit_rate, bits, bits + INTERMISSION_BITS);
    }
    for (unsigned i = 0; i < bus->count; i++)
        if ((contest.contestants & ~contest.winners & bit_of(i)) != 0)
            bus->nodes[i].counters.lost_arbitrations++;
}

static void end_for_sender(struct can_bus *bus, struct node *node)
{
    const struct attempt *attempt = &bus->attempt;
    bool was_passive = node_passive(node);
    if (attempt->outcome == SENT) {
        node_sent(node, &attempt->frame);
    } else if (attempt->outcome == NOT_ACKNOWLEDGED) {
        node->counters.not_acknowledged++;
        if (!was_passive)
            node_send_failed(node); /* a passive node that is alone counts no further */
    } else {
        node_send_failed(node);
    }
    if (attempt->outcome != SENT)
        node_keep(node);
    if (was_passive || node_passive(node))
        node->ready_ns = attempt->free_ns + bits_ns(SUSPENDED, node->bit_rate);
}

static void end_for_receiver(struct can_bus *bus, unsigned number)
{
    const struct attempt *attempt = &bus->attempt;
    struct node *node = &bus->nodes[number];
    if ((attempt->disturbed & bit_of(number)) != 0)
        node_receive_failed(node, 1 + (node_passive(node) ? 0 : 8)); /* 8: it was the first */
    else if (attempt->outcome == SENT)
        node_deliver(bus, node, &attempt->frame);
    else if (attempt->outcome == DESTROYED && bus->stuck == CAN_NOT_STUCK)
        node_receive_failed(node, 1);
}

/* A node in bus-off has seen 11 recessive bits at the end of each frame and of each error frame. */
static void count_recovery(struct can_bus *bus)
{
    for (unsigned i = 0; i < bus->count; i++)
        if (bus->nodes[i].bus_off)
            bus->nodes[i].idles++;
}

void attempt_end(struct can_bus *bus)
{
    struct attempt *attempt = &bus->attempt;
    bool sent = attempt->outcome == SENT;
    attempt->under_way = false;
    attempt->frame.time_ns = attempt->end_ns;
    bus->free_ns = attempt->free_ns;
    bus->counters.frames += sent;
    bus->counters.error_frames += !sent;
    bus->counters.busy_ns += attempt->free_ns - attempt->begin_ns;
    count_recovery(bus);
    for (unsigned i = 0; i < bus->count; i++) {
        struct node *node = &bus->nodes[i];
        if (!node_takes_part(node))
            continue;
        if ((attempt->senders & bit_of(i)) != 0)
            end_for_sender(bus, node);
        else
            end_for_receiver(bus, i);
    }
}
