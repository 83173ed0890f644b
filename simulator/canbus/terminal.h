/* A terminal between a CAN bus and a process image: the CAN interface profile of EtherCAT terminals.
 *
 * Where its numbers lie is data: several makers have the same handshake, and other layouts. The
 * functions are those of `can.h` in all that matters: negative errno values, any thread.
 */
#ifndef ECAT_CAN_TERMINAL_H
#define ECAT_CAN_TERMINAL_H

#include "can.h"

/* A number in a block of bytes: a little-endian word at byte `at`. */
struct can_field {
    uint16_t at;
    uint8_t size; /* bytes of the word: 1, 2 or 4; 0 = there is no such number */
    uint8_t shift, bits;
    uint8_t unused;
};

/* Frames in a process image; the fields are relative to the frame. */
struct can_messages {
    uint16_t first, stride, data;
    struct can_field length, identifier, remote, extended, transaction;
};

struct can_layout {
    struct can_messages received, sent;
    /* In the inputs. */
    struct can_field tx_echo, rx_counter, rx_count, transaction;
    struct can_field bus_off, warning, error_passive, receive_overflow, send_overflow, send_error,
        receive_full, receive_errors, send_errors;
    /* In the outputs. */
    struct can_field tx_counter, rx_ack, tx_count, reset;
};

enum can_terminal_mode { CAN_BUFFERED, CAN_FAST, CAN_OPTIMIZED };

struct can_terminal_config {
    struct can_layout layout;
    uint32_t mode; /* enum can_terminal_mode */
    uint32_t receive_queue, send_queue; /* frames in the process image */
    uint32_t handshake_cycles; /* from an acknowledgement to the answer, at least 1 */
};

struct can_terminal_status {
    uint32_t rx_counter, tx_echo;
    uint64_t rx_batches, tx_batches; /* batches that were given, and taken */
    uint64_t malformed; /* frames and counts that no terminal can take */
};

struct can_terminal;

/* Makes the terminal of a node; NULL if memory is short. */
CAN_API struct can_terminal *can_terminal_create(struct can_bus *bus, int node);
CAN_API void can_terminal_destroy(struct can_terminal *terminal);
/* Sets it up, as on the way to SAFEOP. The counters of the handshake stay. */
CAN_API int can_terminal_configure(struct can_terminal *terminal,
                                   const struct can_terminal_config *config);
/* Forgets the frames received so far, as on the way to OP. */
CAN_API void can_terminal_begin(struct can_terminal *terminal, int64_t now_ns);
/* Sets the counters of the handshake to 0, as in INIT. */
CAN_API void can_terminal_reset(struct can_terminal *terminal);
CAN_API void can_terminal_status(struct can_terminal *terminal, struct can_terminal_status *status);

/* One cycle: takes the outputs (NULL unless they count) and updates the inputs, which keep what
 * they had elsewhere. `terminal` is a `struct can_terminal`: this function is a program of a slave
 * controller. */
CAN_API void can_terminal_cycle(void *terminal, int64_t now_ns, const uint8_t *outputs,
                                size_t output_size, uint8_t *inputs, size_t input_size);

#endif
