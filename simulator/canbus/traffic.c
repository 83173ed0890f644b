/* Sources of frames, and checks that count them elsewhere. Both are for tests with much traffic. */
#include "bus.h"

int64_t source_due_ns(const struct source *source)
{
    const struct can_source *settings = &source->settings;
    if (settings->count != 0 && source->sent >= settings->count)
        return NEVER;
    return settings->first_ns + (int64_t)source->sent * settings->period_ns;
}

/* Returns frame `number` of a source. */
static struct can_frame made(const struct can_source *settings, uint64_t number)
{
    struct can_frame frame = {
        .id = settings->id + (uint32_t)(number % settings->span),
        .flags = (uint8_t)settings->flags,
        .length = (uint8_t)settings->length,
    };
    for (unsigned i = 0; i < sizeof frame.data; i++)
        if (i < settings->length && (settings->flags & CAN_REMOTE) == 0)
            frame.data[i] = (uint8_t)(number >> 8 * i & 0xFF);
    return frame;
}

struct can_frame source_frame(const struct source *source)
{
    return made(&source->settings, source->sent);
}

/* Returns after how many numbers frames of a source are the same again; 0 = after 2^64. */
static uint64_t repeats(const struct can_source *settings)
{
    if (settings->length >= 8)
        return 0;
    uint64_t values = (settings->flags & CAN_REMOTE) != 0 ? 1 : UINT64_C(1) << 8 * settings->length;
    /* Identifier and data count together: the number is known modulo each of them. */
    return values > settings->span ? values : settings->span;
}

/* Finds the number of a frame near the expected one: it says how many are missing, or, in the upper
 * half, that the frame has come before. */
static uint64_t ahead_of(const struct check *check, const struct can_frame *frame)
{
    const struct can_source *settings = &check->settings;
    uint64_t modulus = repeats(settings), number = 0;
    if (settings->span > 1 && modulus == settings->span) {
        number = frame->id - settings->id;
    } else {
        for (unsigned i = 0; i < sizeof frame->data && i < frame->length; i++)
            number |= (uint64_t)frame->data[i] << 8 * i;
    }
    uint64_t difference = number - check->next;
    if (modulus == 0)
        return difference;
    return (number + modulus - check->next % modulus) % modulus;
}

static bool same_frame(const struct can_frame *one, const struct can_frame *other)
{
    return one->id == other->id && one->length == other->length && one->flags == other->flags &&
           memcmp(one->data, other->data, sizeof one->data) == 0;
}

void check_frame(struct check *check, const struct can_frame *frame)
{
    const struct can_source *settings = &check->settings;
    if (frame->id - settings->id >= settings->span || frame->flags != settings->flags)
        return;
    uint64_t modulus = repeats(settings);
    uint64_t ahead = ahead_of(check, frame), number = check->next + ahead;
    struct can_frame expected = made(settings, number);
    check->status.received++;
    if (!same_frame(frame, &expected)) {
        check->status.wrong++;
    } else if (!check->begun) {
        check->begun = true; /* frames before the first one are nobody's loss */
        check->next = number + 1;
    } else if (ahead > (modulus == 0 ? UINT64_MAX : modulus) / 2) {
        check->status.doubled++;
    } else {
        check->status.lost += ahead;
        check->next = number + 1;
    }
}

int can_add_source(struct can_bus *bus, int number, const struct can_source *source, int64_t now_ns)
{
    int result = -ENOSPC;
    struct node *node = bus_enter(bus, number);
    if (node == NULL)
        return -ENODEV;
    bus_advance(bus, now_ns);
    if (source->span == 0 || source->length > 8 || source->period_ns < 0)
        result = -EINVAL;
    else if (node->source_count < CAN_MAX_SOURCES) {
        node->sources[node->source_count] = (struct source){.settings = *source};
        result = (int)node->source_count++;
    }
    bus_leave(bus);
    return result;
}

int can_clear_sources(struct can_bus *bus, int number, int64_t now_ns)
{
    struct node *node = bus_enter(bus, number);
    if (node == NULL)
        return -ENODEV;
    bus_advance(bus, now_ns);
    node->source_count = 0;
    bus_leave(bus);
    return 0;
}

int64_t can_source_sent(struct can_bus *bus, int number, int source)
{
    struct node *node = bus_enter(bus, number);
    if (node == NULL)
        return -ENODEV;
    bool known = source >= 0 && (unsigned)source < node->source_count;
    int64_t result = known ? (int64_t)node->sources[source].sent : -ENOENT;
    bus_leave(bus);
    return result;
}

int can_add_check(struct can_bus *bus, int number, const struct can_source *source)
{
    int result = -ENOSPC;
    struct node *node = bus_enter(bus, number);
    if (node == NULL)
        return -ENODEV;
    if (source->span == 0 || source->length > 8)
        result = -EINVAL;
    else if (node->check_count < CAN_MAX_CHECKS) {
        node->checks[node->check_count] = (struct check){.settings = *source};
        result = (int)node->check_count++;
    }
    bus_leave(bus);
    return result;
}

int can_check_status(struct can_bus *bus, int number, int check, struct can_check_status *status)
{
    struct node *node = bus_enter(bus, number);
    if (node == NULL)
        return -ENODEV;
    bool known = check >= 0 && (unsigned)check < node->check_count;
    if (known)
        *status = node->checks[check].status;
    bus_leave(bus);
    return known ? 0 : -ENOENT;
}

int can_set_echo(struct can_bus *bus, int number, uint32_t change)
{
    struct node *node = bus_enter(bus, number);
    if (node == NULL)
        return -ENODEV;
    node->echo = change;
    bus_leave(bus);
    return 0;
}
