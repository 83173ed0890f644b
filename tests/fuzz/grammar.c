/* What masters send, at random: commands, addresses and data that lead deep into the ESC. */
#include "fuzz.h"

#include <string.h>

enum {
    NOP, APRD, APWR, APRW, FPRD, FPWR, FPRW, BRD, BWR, BRW, LRD, LWR, LRW, ARMW, FRMW, COMMANDS,
    HEAD = 16, /* Ethernet header and frame header */
    OVERHEAD = 12,
    MAILBOX_OUT = 0x1000, MAILBOX_IN = 0x1080, OUTPUTS = 0x1100, INPUTS = 0x1200,
    MAILBOX_SIZE = 128, DATA_SIZE = 16,
    LOGICAL = 0x10000
};

/* Where something happens when a master reads or writes: register, and bytes it usually takes. */
static const struct {
    uint16_t address, size;
} interesting[] = {
    {0x0000, 16},  {0x0010, 2},   {0x0012, 2},   {0x0020, 2},   {0x0030, 2},   {0x0040, 1},
    {0x0041, 1},   {0x0100, 4},   {0x0108, 2},   {0x0110, 2},   {0x0120, 2},
    {0x0130, 6},   {0x0140, 2},   {0x0150, 4},   {0x0200, 2},   {0x0204, 4},   {0x0210, 2},
    {0x0220, 4},   {0x0300, 20},  {0x0310, 4},   {0x0400, 2},   {0x0410, 2},   {0x0420, 2},
    {0x0440, 4},   {0x0500, 2},   {0x0502, 6},   {0x0502, 14},  {0x0508, 8},   {0x0600, 16},
    {0x0610, 32},  {0x06F0, 16},  {0x0800, 8},   {0x0808, 8},   {0x0810, 16},  {0x0805, 3},
    {0x080E, 1},   {0x0878, 8},   {0x0900, 4},   {0x0900, 16},  {0x0910, 8},   {0x0918, 8},
    {0x0920, 8},   {0x0928, 4},   {0x092C, 4},   {0x0930, 4},   {0x0934, 2},   {0x0980, 2},
    {0x0981, 1},   {0x0982, 2},   {0x0990, 8},   {0x09A0, 4},   {0x09A4, 4},   {0x09A8, 2},
    {0x09AE, 2},   {0x09B0, 32},  {0x0F00, 4},   {0x0F10, 8},   {0x0F80, 128}, {0x0FF8, 16},
    {0x1000, 128}, {0x1000, 1},   {0x107F, 1},   {0x1080, 128}, {0x1080, 16},  {0x10FF, 1},
    {0x1100, 16},  {0x1110, 16},  {0x1120, 16},  {0x1200, 16},  {0x2FF0, 16},  {0x2FFF, 2},
    {0xFFF0, 16},  {0xFFFF, 1},
};

static void put16(uint8_t *at, unsigned value)
{
    at[0] = (uint8_t)value;
    at[1] = (uint8_t)(value >> 8);
}

static void put32(uint8_t *at, uint32_t value)
{
    put16(at, value & 0xFFFF);
    put16(at + 2, value >> 16);
}

static uint8_t *begin(uint8_t *frame)
{
    memset(frame, 0xFF, 6);
    memset(frame + 6, 0x10, 6);
    frame[12] = 0x88;
    frame[13] = 0xA4;
    return frame + HEAD;
}

static size_t finish(uint8_t *frame, const uint8_t *end)
{
    put16(frame + 14, 0x1000U | ((unsigned)(end - frame - HEAD) & 0x7FF));
    return (size_t)(end - frame);
}

/* The header of a datagram; returns where its data go. */
static uint8_t *head(uint8_t *at, unsigned command, unsigned key, unsigned address, unsigned size)
{
    at[0] = (uint8_t)command;
    at[1] = 0;
    put16(at + 2, key);
    put16(at + 4, address);
    put16(at + 6, size);
    put16(at + 8, 0);
    memset(at + 10, 0, size + 2);
    return at + 10;
}

static void put_sync_manager(uint8_t *data, unsigned start, unsigned size, unsigned control)
{
    put16(data, start);
    put16(data + 2, size);
    data[4] = (uint8_t)control;
    data[5] = 0;
    data[6] = 1;
    data[7] = 0;
}

static void put_fmmu(uint8_t *data, uint32_t logical, unsigned size, unsigned physical,
                     unsigned type)
{
    memset(data, 0, 16);
    put32(data, logical);
    put16(data + 4, size);
    data[7] = 7;
    put16(data + 8, physical);
    data[11] = (uint8_t)type;
    data[12] = 1;
}

size_t set_up_frame(unsigned step, unsigned slave, uint8_t *frame)
{
    static const uint8_t states[] = {0x11, 0x12, 0x14, 0x18};
    uint8_t *at = begin(frame), *data;
    unsigned key = 0x10000U - slave;
    uint32_t logical = LOGICAL + 2 * DATA_SIZE * slave;
    if (step == 0) {
        data = head(at, APWR, key, 0x0010, 2);
        put16(data, 0x1001 + slave);
        return finish(frame, data + 2 + 2);
    }
    if (step == 2) {
        data = head(at, APWR, key, 0x0800, 32);
        put_sync_manager(data, MAILBOX_OUT, MAILBOX_SIZE, 0x26);
        put_sync_manager(data + 8, MAILBOX_IN, MAILBOX_SIZE, 0x22);
        put_sync_manager(data + 16, OUTPUTS, DATA_SIZE, 0x64);
        put_sync_manager(data + 24, INPUTS, DATA_SIZE, 0x20);
        return finish(frame, data + 32 + 2);
    }
    if (step == 4) {
        data = head(at, APWR, key, 0x0600, 32);
        put_fmmu(data, logical, DATA_SIZE, OUTPUTS, 2);
        put_fmmu(data + 16, logical + DATA_SIZE, DATA_SIZE, INPUTS, 1);
        return finish(frame, data + 32 + 2);
    }
    if (step == 6) {
        data = head(at, LRW, logical & 0xFFFF, logical >> 16, 2 * DATA_SIZE);
        return finish(frame, data + 2 * DATA_SIZE + 2);
    }
    if (step == 8) { /* SYNC0 every 1000 ns, SYNC1 500 ns behind it, at once */
        data = head(at, APWR, key, 0x09A0, 8);
        put32(data, 1000);
        put32(data + 4, 500);
        return finish(frame, data + 8 + 2);
    }
    if (step == 9) {
        data = head(at, APWR, key, 0x0980, 2);
        data[1] = 0x27;
        return finish(frame, data + 2 + 2);
    }
    data = head(at, APWR, key, 0x0120, 2);
    data[0] = states[step / 2];
    return finish(frame, data + 2 + 2);
}

/* Data that mean something where they are written. */
static void meaningful(struct source *source, unsigned address, uint8_t *data, unsigned size)
{
    static const uint8_t eeprom[] = {0x00, 0x01, 0x02, 0x03, 0x04, 0x05, 0x07};
    static const uint8_t reset[] = {'R', 'E', 'S'};
    uint32_t choice = draw(source);
    if (address == 0x0010 && size >= 2)
        put16(data, 0x1001 + choice % 8);
    else if (address == 0x0120)
        data[0] = (uint8_t)(choice & 0x1F);
    else if (address < 0x0040 && !one_in(source, 64))
        memset(data, 0, size); /* write protection would end it all */
    else if (address == 0x0040)
        data[0] = reset[choice % sizeof reset];
    else if (address == 0x0100 && size >= 4)
        put32(data, (choice & (one_in(source, 64) ? 0x01FFFF03 : 0x01070003)) | 1);
    else if (address == 0x0502 && size >= 6) {
        data[0] = (uint8_t)(choice & 1);
        data[1] = eeprom[(choice >> 1) % sizeof eeprom];
        put32(data + 2, one_in(source, 8) ? draw(source) : below(source, 600));
    } else if (address == 0x0500)
        data[0] = (uint8_t)(choice & 3);
    else if (address >= 0x0600 && address < 0x0700 && size >= 16) {
        put_fmmu(data, LOGICAL + below(source, 256), below(source, 64), 0x10F0 + below(source, 512),
                 below(source, 4));
        if (one_in(source, 2)) {
            data[6] = (uint8_t)below(source, 8);
            data[7] = (uint8_t)below(source, 8);
            data[10] = (uint8_t)below(source, 8);
        }
        if (one_in(source, 16))
            put32(data, draw(source));
        if (one_in(source, 16))
            put16(data + 8, draw(source) & 0xFFFF);
    } else if (address >= 0x0800 && address < 0x0880 && size >= 8) {
        static const uint8_t control[] = {0x26, 0x22, 0x64, 0x20, 0x24, 0x66, 0x21, 0x2A};
        put_sync_manager(data, 0x1000 + below(source, 0x300), below(source, 0x100),
                         control[choice % sizeof control]);
        data[6] = (uint8_t)(choice >> 8 & 3);
    } else if (address >= 0x0980 && address < 0x0982)
        data[size - 1] = (uint8_t)(choice & 7);
    else if ((address == 0x0990 || address == 0x09A0) && size >= 4)
        put32(data, choice >> below(source, 32));
}

static unsigned any_address(struct source *source, unsigned *size)
{
    unsigned at = below(source, sizeof interesting / sizeof interesting[0]);
    unsigned address = interesting[at].address;
    *size = interesting[at].size;
    if (one_in(source, 8)) {
        address = (address + below(source, 33) - 16) & 0xFFFF;
        *size = 1 + below(source, 64);
    }
    if (one_in(source, 64)) {
        address = draw(source) & 0xFFFF;
        *size = below(source, 1600);
    }
    return address;
}

/* One datagram, if there is room for it before `end`; returns where it ends. */
static uint8_t *any_datagram(struct source *source, uint8_t *at,
                             const uint8_t *end)
{
    unsigned command = one_in(source, 64) ? draw(source) & 0xFF : below(source, COMMANDS);
    unsigned size, address = any_address(source, &size), key = draw(source) & 0xFFFF;
    bool logical = command >= LRD && command <= LRW;
    if (logical) {
        uint32_t where = one_in(source, 32) ? draw(source) : LOGICAL - 16 + below(source, 300);
        key = where & 0xFFFF;
        address = where >> 16;
        size = below(source, one_in(source, 16) ? 1400 : 200);
    } else if (!one_in(source, 16)) {
        bool station = (command >= FPRD && command <= FPRW) || command == FRMW;
        key = station ? 0x1001 + below(source, slaves + 1) : 0x10000U - below(source, slaves + 1);
    }
    if (end - at < (ptrdiff_t)(OVERHEAD + size))
        return at;
    uint8_t *data = head(at, command, key & 0xFFFF, address & 0xFFFF, size);
    fill(source, data, size);
    if (!logical && size > 0 && !one_in(source, 8))
        meaningful(source, address, data, size);
    if (one_in(source, 4)) /* a working counter and an IRQ field that others have touched */
        fill(source, data + size, 2);
    return data + size + 2;
}

/* The sequence that resets a slave. */
static size_t reset_frame(struct source *source, uint8_t *frame)
{
    unsigned key = 0x10000U - below(source, slaves);
    uint8_t *at = begin(frame);
    for (const char *letter = "RES"; *letter != '\0'; letter++) {
        uint8_t *data = head(at, APWR, key & 0xFFFF, 0x0040, 1);
        data[0] = (uint8_t)*letter;
        if (letter[1] != '\0')
            at[7] |= 0x80;
        at = data + 1 + 2;
    }
    return finish(frame, at);
}

/* A whole mailbox, or all outputs, or all inputs. */
static size_t channel_frame(struct source *source, uint8_t *frame)
{
    static const struct {
        uint8_t command;
        uint16_t address, size;
    } channels[] = {{APWR, MAILBOX_OUT, MAILBOX_SIZE},
                    {APRD, MAILBOX_IN, MAILBOX_SIZE},
                    {APWR, OUTPUTS, DATA_SIZE},
                    {APRD, INPUTS, DATA_SIZE}};
    unsigned which = below(source, 4), size = channels[which].size;
    unsigned key = 0x10000U - below(source, slaves);
    uint8_t *data = head(begin(frame), channels[which].command, key & 0xFFFF,
                         channels[which].address, size);
    fill(source, data, size);
    return finish(frame, data + size + 2);
}

static size_t valid_frame(struct source *source, uint8_t *frame)
{
    unsigned count = 1 + below(source, one_in(source, 4) ? 15 : 3);
    uint8_t *at = begin(frame), *last = NULL;
    const uint8_t *end = frame + (one_in(source, 16) ? MAX_FRAME : 1514);
    for (unsigned i = 0; i < count; i++) {
        uint8_t *next = any_datagram(source, at, end);
        if (next == at)
            continue;
        if (last != NULL)
            last[7] |= 0x80; /* more follow */
        last = at;
        at = next;
    }
    return finish(frame, at);
}

static size_t mutate(struct source *source, uint8_t *frame, size_t size)
{
    switch (below(source, 4)) {
    case 0: /* bits flipped, most often where the lengths stand */
        for (unsigned i = 1 + below(source, 4); i > 0 && size > 0; i--) {
            size_t limit = one_in(source, 2) && size > 40 ? 40 : size;
            frame[below(source, (uint32_t)limit)] ^= (uint8_t)(1U << below(source, 8));
        }
        return size;
    case 1:
        return below(source, (uint32_t)size + 1);
    case 2: { /* padding, or bytes that no length accounts for */
        size_t more = below(source, (uint32_t)(MAX_FRAME - size) + 1);
        fill(source, frame + size, more);
        return size + more;
    }
    default:
        if (size >= HEAD)
            put16(frame + 14, draw(source) & 0xFFFF);
        return size;
    }
}

size_t random_frame(struct source *source, uint8_t *frame)
{
    if (one_in(source, 16)) {
        size_t size = below(source, 1600);
        fill(source, frame, size);
        if (size >= HEAD && one_in(source, 2))
            begin(frame);
        return size;
    }
    size_t size = one_in(source, 512)  ? reset_frame(source, frame)
                  : one_in(source, 16) ? channel_frame(source, frame)
                                       : valid_frame(source, frame);
    return one_in(source, 8) ? mutate(source, frame, size) : size;
}
