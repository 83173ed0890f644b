/* The cycle of a terminal: batches of frames with a handshake, and the state of the controller. */
#include "bus.h"
#include "terminal.h"

struct can_terminal {
    struct can_bus *bus;
    struct node *node;
    struct can_terminal_config config;
    unsigned rx_age, tx_age; /* cycles for which it could have answered */
    bool has_outputs;
    bool overflow, send_overflow; /* since its queue was empty, or since the last reset */
    uint64_t overflowed;          /* of the node, when it was looked at last */
    struct can_terminal_status status;
};

static uint32_t load(const uint8_t *block, const struct can_field *field)
{
    uint32_t word = 0;
    for (unsigned i = 0; i < field->size; i++)
        word |= (uint32_t)block[field->at + i] << 8 * i;
    return word >> field->shift & (uint32_t)((UINT64_C(1) << field->bits) - 1);
}

static void store(uint8_t *block, const struct can_field *field, uint32_t value)
{
    uint32_t mask = (uint32_t)((UINT64_C(1) << field->bits) - 1) << field->shift;
    uint32_t bits = value << field->shift & mask;
    for (unsigned i = 0; i < field->size; i++) {
        uint8_t *byte = block + field->at + i;
        *byte = (uint8_t)((*byte & ~(mask >> 8 * i)) | (bits >> 8 * i & 0xFF));
    }
}

/* --- received frames -------------------------------------------------------------------------- */

static void put_frame(const struct can_messages *messages, uint8_t *block,
                      const struct can_frame *frame)
{
    memset(block, 0, messages->stride);
    store(block, &messages->length, frame->length);
    store(block, &messages->identifier, frame->id);
    store(block, &messages->remote, (frame->flags & CAN_REMOTE) != 0);
    store(block, &messages->extended, (frame->flags & CAN_EXTENDED) != 0);
    memcpy(block + messages->data, frame->data, sizeof frame->data);
}

static unsigned put_batch(struct can_terminal *terminal, uint8_t *inputs)
{
    const struct can_messages *messages = &terminal->config.layout.received;
    struct queue *queue = &terminal->node->receive;
    unsigned count = 0;
    for (; count < terminal->config.receive_queue && queue->count > 0; count++) {
        put_frame(messages, inputs + messages->first + count * messages->stride, queue_head(queue));
        queue_pop(queue);
    }
    return count;
}

/* In fast mode nothing is kept: what does not fit into this cycle is lost. */
static void lose_rest(struct can_terminal *terminal)
{
    struct node *node = terminal->node;
    node->counters.overflowed += node->receive.count;
    node->receive.count = 0;
}

static bool may_give(struct can_terminal *terminal, const uint8_t *outputs)
{
    const struct can_terminal_config *config = &terminal->config;
    if (config->mode != CAN_BUFFERED)
        return true;
    if (load(outputs, &config->layout.rx_ack) != terminal->status.rx_counter) {
        terminal->rx_age = 0;
        return false;
    }
    if (terminal->rx_age < config->handshake_cycles)
        terminal->rx_age++;
    return terminal->rx_age == config->handshake_cycles;
}

static uint32_t next_counter(uint32_t counter, const struct can_field *field)
{
    return (counter + 1) & (uint32_t)((UINT64_C(1) << field->bits) - 1);
}

static void give(struct can_terminal *terminal, const uint8_t *outputs, uint8_t *inputs)
{
    const struct can_layout *layout = &terminal->config.layout;
    if (!may_give(terminal, outputs))
        return;
    unsigned count = put_batch(terminal, inputs);
    if (terminal->config.mode == CAN_FAST)
        lose_rest(terminal);
    if (count == 0)
        return;
    terminal->rx_age = 0;
    terminal->status.rx_batches++;
    terminal->status.rx_counter = next_counter(terminal->status.rx_counter, &layout->rx_counter);
    store(inputs, &layout->rx_count, count);
}

/* --- frames to send --------------------------------------------------------------------------- */

static bool get_frame(const struct can_messages *messages, const uint8_t *block,
                      struct can_frame *frame)
{
    *frame = (struct can_frame){
        .id = load(block, &messages->identifier),
        .tag = load(block, &messages->transaction),
        .length = (uint8_t)load(block, &messages->length),
    };
    if (load(block, &messages->remote) != 0)
        frame->flags |= CAN_REMOTE;
    if (load(block, &messages->extended) != 0)
        frame->flags |= CAN_EXTENDED;
    else
        frame->id &= 0x7FF;
    if (frame->length > sizeof frame->data)
        return false;
    if ((frame->flags & CAN_REMOTE) == 0)
        memcpy(frame->data, block + messages->data, frame->length);
    return true;
}

static void take_batch(struct can_terminal *terminal, const uint8_t *outputs, unsigned count)
{
    const struct can_messages *messages = &terminal->config.layout.sent;
    for (unsigned i = 0; i < count; i++) {
        struct can_frame frame;
        if (!get_frame(messages, outputs + messages->first + i * messages->stride, &frame))
            terminal->status.malformed++;
        else if (bus_push(terminal->bus, terminal->node, &frame) == 0)
            terminal->send_overflow = true;
    }
}

/* Takes a batch as a whole, as soon as there is room for it. */
static void take(struct can_terminal *terminal, const uint8_t *outputs)
{
    const struct can_terminal_config *config = &terminal->config;
    const struct queue *queue = &terminal->node->transmit;
    uint32_t counter = load(outputs, &config->layout.tx_counter);
    uint32_t count = load(outputs, &config->layout.tx_count);
    uint32_t cycles = config->mode == CAN_BUFFERED ? config->handshake_cycles : 1;
    if (counter == terminal->status.tx_echo) {
        terminal->tx_age = 0;
        return;
    }
    bool too_many = count > config->send_queue;
    count = too_many ? config->send_queue : count;
    if (terminal->tx_age < cycles)
        terminal->tx_age++;
    if (terminal->tx_age < cycles || queue->capacity - queue->count < count)
        return;
    terminal->tx_age = 0;
    terminal->status.malformed += too_many;
    take_batch(terminal, outputs, count);
    terminal->status.tx_batches++;
    terminal->status.tx_echo = counter;
}

/* --- the controller --------------------------------------------------------------------------- */

static void watch_overflow(struct can_terminal *terminal, const uint8_t *outputs)
{
    const struct can_field *reset = &terminal->config.layout.reset;
    const struct node *node = terminal->node;
    if (reset->size > 0 ? outputs != NULL && load(outputs, reset) != 0 : node->receive.count == 0)
        terminal->overflow = terminal->send_overflow = false;
    if (node->counters.overflowed > terminal->overflowed)
        terminal->overflow = true;
    terminal->overflowed = node->counters.overflowed;
}

static void tell_state(const struct can_terminal *terminal, uint8_t *inputs)
{
    const struct can_layout *layout = &terminal->config.layout;
    const struct node *node = terminal->node;
    enum can_state state = node_state(node);
    bool silent = node->transmit_errors >= PASSIVE_AT || state == CAN_BUS_OFF;
    store(inputs, &layout->tx_echo, terminal->status.tx_echo);
    store(inputs, &layout->rx_counter, terminal->status.rx_counter);
    store(inputs, &layout->transaction, node->counters.last_tag);
    store(inputs, &layout->bus_off, state == CAN_BUS_OFF);
    store(inputs, &layout->warning, state == CAN_WARNING || state == CAN_PASSIVE);
    store(inputs, &layout->error_passive, state == CAN_PASSIVE);
    store(inputs, &layout->receive_overflow, terminal->overflow);
    store(inputs, &layout->send_overflow, terminal->send_overflow);
    store(inputs, &layout->send_error, silent && node->transmit.count > 0);
    store(inputs, &layout->receive_full, node->receive.count == node->receive.capacity);
    store(inputs, &layout->receive_errors, node->receive_errors);
    store(inputs, &layout->send_errors, node->transmit_errors < 255 ? node->transmit_errors : 255);
}

/* Outputs that no longer count take with them what still waits. */
static void follow_outputs(struct can_terminal *terminal, const uint8_t *outputs)
{
    if (outputs == NULL && terminal->has_outputs)
        node_cancel(terminal->bus, terminal->node);
    if (outputs == NULL)
        terminal->rx_age = terminal->tx_age = 0;
    terminal->has_outputs = outputs != NULL;
}

static bool fits(const struct can_terminal_config *config, size_t output_size, size_t input_size)
{
    const struct can_messages *received = &config->layout.received, *sent = &config->layout.sent;
    return config->receive_queue > 0 &&
           received->first + (size_t)received->stride * config->receive_queue <= input_size &&
           sent->first + (size_t)sent->stride * config->send_queue <= output_size;
}

void can_terminal_cycle(void *context, int64_t now_ns, const uint8_t *outputs, size_t output_size,
                        uint8_t *inputs, size_t input_size)
{
    struct can_terminal *terminal = context;
    struct can_bus *bus = terminal->bus;
    pthread_mutex_lock(&bus->lock);
    bus_advance(bus, now_ns);
    if (fits(&terminal->config, output_size, input_size)) {
        follow_outputs(terminal, outputs);
        if (outputs != NULL) {
            give(terminal, outputs, inputs);
            take(terminal, outputs);
        }
        watch_overflow(terminal, outputs);
        tell_state(terminal, inputs);
    }
    pthread_mutex_unlock(&bus->lock);
}

/* --- calls ------------------------------------------------------------------------------------ */

struct can_terminal *can_terminal_create(struct can_bus *bus, int number)
{
    struct node *node = bus_enter(bus, number);
    if (node == NULL)
        return NULL;
    struct can_terminal *terminal = calloc(1, sizeof *terminal);
    if (terminal != NULL) {
        terminal->bus = bus;
        terminal->node = node;
    }
    bus_leave(bus);
    return terminal;
}

void can_terminal_destroy(struct can_terminal *terminal) { free(terminal); }

int can_terminal_configure(struct can_terminal *terminal, const struct can_terminal_config *config)
{
    if (config->handshake_cycles == 0 || config->receive_queue == 0 || config->send_queue == 0)
        return -EINVAL;
    pthread_mutex_lock(&terminal->bus->lock);
    terminal->config = *config;
    terminal->rx_age = terminal->tx_age = 0;
    terminal->has_outputs = terminal->overflow = terminal->send_overflow = false;
    pthread_mutex_unlock(&terminal->bus->lock);
    return 0;
}

void can_terminal_begin(struct can_terminal *terminal, int64_t now_ns)
{
    pthread_mutex_lock(&terminal->bus->lock);
    bus_advance(terminal->bus, now_ns);
    terminal->node->receive.count = 0;
    terminal->overflowed = terminal->node->counters.overflowed;
    terminal->overflow = false;
    pthread_mutex_unlock(&terminal->bus->lock);
}

void can_terminal_reset(struct can_terminal *terminal)
{
    pthread_mutex_lock(&terminal->bus->lock);
    terminal->status = (struct can_terminal_status){.rx_counter = 0};
    terminal->rx_age = terminal->tx_age = 0;
    terminal->overflowed = 0;
    pthread_mutex_unlock(&terminal->bus->lock);
}

void can_terminal_status(struct can_terminal *terminal, struct can_terminal_status *status)
{
    pthread_mutex_lock(&terminal->bus->lock);
    *status = terminal->status;
    pthread_mutex_unlock(&terminal->bus->lock);
}
