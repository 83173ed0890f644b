/* The bits of a frame on the wire (ISO 11898-1, 10.4 and 10.5). */
#include "bus.h"

enum {
    CRC_POLYNOMIAL = 0x4599,
    CRC_BITS = 15,
    STUFFED_AFTER = 5, /* equal bits */
    ACK_BITS = 3,      /* delimiter of the CRC, slot, delimiter */
    END_BITS = 7
};

/* Bits as they are added: with stuff bits, and their CRC. */
struct stream {
    uint8_t *bits; /* NULL = only counted */
    unsigned count;
    unsigned crc;
    unsigned equal, last;
};

static void put_raw(struct stream *stream, unsigned bit)
{
    if (stream->bits != NULL)
        stream->bits[stream->count] = (uint8_t)bit;
    stream->count++;
}

static void put_bit(struct stream *stream, unsigned bit)
{
    stream->equal = bit == stream->last ? stream->equal + 1 : 1;
    stream->last = bit;
    put_raw(stream, bit);
    unsigned inverted = bit ^ (stream->crc >> (CRC_BITS - 1) & 1);
    stream->crc = (stream->crc << 1 & 0x7FFF) ^ (inverted ? CRC_POLYNOMIAL : 0);
    if (stream->equal == STUFFED_AFTER) {
        stream->last = !bit;
        stream->equal = 1;
        put_raw(stream, !bit);
    }
}

static void put(struct stream *stream, uint32_t value, unsigned bits)
{
    while (bits-- > 0)
        put_bit(stream, value >> bits & 1);
}

static void put_all(struct stream *stream, const struct can_frame *frame)
{
    unsigned remote = (frame->flags & CAN_REMOTE) != 0;
    put(stream, 0, 1); /* start of frame */
    if ((frame->flags & CAN_EXTENDED) != 0) {
        put(stream, frame->id >> 18 & 0x7FF, 11);
        put(stream, 3, 2); /* SRR, IDE */
        put(stream, frame->id & 0x3FFFF, 18);
        put(stream, remote, 1);
        put(stream, 0, 2);
    } else {
        put(stream, frame->id & 0x7FF, 11);
        put(stream, remote, 1);
        put(stream, 0, 2);
    }
    put(stream, frame->length, 4);
    for (unsigned i = 0; i < frame->length && !remote; i++)
        put(stream, frame->data[i], 8);
    put(stream, stream->crc, CRC_BITS);
}

/* Returns the bits up to the end of the CRC. */
unsigned bits_to_crc(const struct can_frame *frame)
{
    struct stream stream = {.last = 2};
    put_all(&stream, frame);
    return stream.count;
}

/* Returns a number that is smaller if the frame wins the arbitration: its bits in that field. */
uint32_t bits_rank(const struct can_frame *frame)
{
    uint32_t remote = (frame->flags & CAN_REMOTE) != 0;
    if ((frame->flags & CAN_EXTENDED) == 0)
        return (frame->id & 0x7FF) << 21 | remote << 20;
    return (frame->id >> 18 & 0x7FF) << 21 | 3U << 19 | (frame->id & 0x3FFFF) << 1 | remote;
}

int can_frame_bits(const struct can_frame *frame, uint8_t *bits, size_t capacity)
{
    uint8_t all[CAN_MAX_BITS];
    struct stream stream = {.bits = all, .last = 2};
    if (frame->length > sizeof frame->data)
        return -EINVAL;
    put_all(&stream, frame);
    for (unsigned i = 0; i < ACK_BITS + END_BITS + INTERMISSION_BITS; i++)
        put_raw(&stream, i != 1); /* only the slot is dominant */
    memcpy(bits, all, stream.count < capacity ? stream.count : capacity);
    return (int)stream.count;
}
