/* Slaves that need nobody to wake: frames of the cycle are answered inside the kernel, by an XDP
 * program on the far end of a veth pair, within the system call that sends them. All other frames go
 * on to whoever serves the far end.
 *
 * usage: responder NEAR FAR
 * Standard input begins with frames and their answers, as somebody who served the far end gave them:
 * how many, and for each its length, the frame, and the answer; numbers are 16 bits, little-endian.
 * From then on a frame with the same datagrams (commands, addresses, lengths) gets the same answer:
 * bytes in which the answer differs from what was sent (working counters, AL status, inputs, the mark
 * in the source address) are written; outputs, indices and all other bytes go back as they came.
 * Says "ready" once it answers. Each further byte on standard input is answered by a line of JSON with
 * the numbers of EtherCAT frames answered here and passed on. Ends when standard input does.
 */
#include "wire.h"

#include <errno.h>
#include <inttypes.h>
#include <linux/bpf.h>
#include <linux/if_link.h>
#include <stddef.h>
#include <string.h>

enum {
    ETHERTYPE_AT = 12,
    FIRST_DATAGRAM = 16,
    HEADER = 10,
    COUNTER = 2,
    MOST_DATAGRAMS = 256,
    MOST_CODE = 30000 /* so that all jumps reach their targets */
};
enum { ANSWERED, PASSED, COUNTERS };
enum { REFUSED = 3 }; /* status */
enum { R0, R1, R2, R3, R4 }; /* registers; from begin() on R2 is the frame, and R3 its end */

static struct bpf_insn code[MOST_CODE];
static uint32_t length;

static int bpf(int command, union bpf_attr *attributes)
{
    return (int)syscall(SYS_bpf, command, attributes, sizeof *attributes);
}

/* --- the program ---------------------------------------------------------------------------- */

static void emit(int operation, int to, int from, int offset, int32_t value)
{
    if (length == MOST_CODE) {
        fprintf(stderr, "responder: too many frames\n");
        exit(1);
    }
    code[length++] = (struct bpf_insn){.code = (uint8_t)operation,
                                       .dst_reg = (uint8_t)to & 15,
                                       .src_reg = (uint8_t)from & 15,
                                       .off = (int16_t)offset,
                                       .imm = value};
}

static void load(int size, int to, int from, int at)
{
    emit(BPF_LDX | BPF_MEM | size, to, from, at, 0);
}

static void store(int size, int at, uint32_t value)
{
    emit(BPF_ST | BPF_MEM | size, R2, 0, at, (int32_t)value);
}

/* Jumps whose targets are the end of the part that deals with one frame. */
static uint32_t open_jumps[3 * MOST_DATAGRAMS + 8], open_count;

static void leave_if(int condition, int one, int other, int32_t value)
{
    open_jumps[open_count++] = length;
    emit(condition, one, other, 0, value);
}

static void land(void)
{
    while (open_count > 0) {
        uint32_t from = open_jumps[--open_count];
        code[from].off = (int16_t)(length - from - 1);
    }
}

static void expect(int size, int at, uint32_t value)
{
    load(size, R4, R2, at);
    if (size == BPF_W)
        leave_if(BPF_JMP32 | BPF_JNE | BPF_K, R4, 0, (int32_t)value);
    else
        leave_if(BPF_JMP | BPF_JNE | BPF_K, R4, 0, (int32_t)value);
}

static void count(int map, int which)
{
    emit(BPF_LD | BPF_DW | BPF_IMM, R1, BPF_PSEUDO_MAP_VALUE, 0, map);
    emit(0, 0, 0, 0, which * 8);
    emit(BPF_ALU64 | BPF_MOV | BPF_K, R4, 0, 0, 1);
    emit(BPF_STX | BPF_ATOMIC | BPF_DW, R1, R4, 0, BPF_ADD);
}

static void leave(int action)
{
    emit(BPF_ALU64 | BPF_MOV | BPF_K, R0, 0, 0, action);
    emit(BPF_JMP | BPF_EXIT, 0, 0, 0, 0);
}

static uint32_t get16(const uint8_t *at) { return (uint32_t)(at[0] | at[1] << 8); }
static uint32_t get32(const uint8_t *at) { return get16(at) | get16(at + 2) << 16; }

/* Leaves unless the frame is of this size (bytes up to `size` may be used then). */
static void expect_size(uint32_t size)
{
    emit(BPF_ALU64 | BPF_MOV | BPF_X, R4, R2, 0, 0);
    emit(BPF_ALU64 | BPF_ADD | BPF_K, R4, 0, 0, (int32_t)size);
    leave_if(BPF_JMP | BPF_JGT | BPF_X, R4, R3, 0);
    emit(BPF_ALU64 | BPF_MOV | BPF_X, R4, R2, 0, 0);
    emit(BPF_ALU64 | BPF_ADD | BPF_K, R4, 0, 0, (int32_t)size + 1);
    leave_if(BPF_JMP | BPF_JLE | BPF_X, R4, R3, 0);
}

/* Leaves unless command, address and length of each datagram are those of `frame`. */
static void expect_datagrams(const uint8_t *frame, uint32_t size)
{
    uint32_t at = FIRST_DATAGRAM, datagrams = 0;
    for (;;) {
        uint32_t field = get16(frame + at + 6), next = at + HEADER + (field & 0x7FF) + COUNTER;
        if (next > size || ++datagrams > MOST_DATAGRAMS) {
            fprintf(stderr, "responder: that is no EtherCAT frame\n");
            exit(1);
        }
        expect(BPF_B, (int)at, frame[at]);
        expect(BPF_W, (int)at + 2, get32(frame + at + 2));
        expect(BPF_H, (int)at + 6, field);
        if ((field & 0x8000) == 0 || next + HEADER + COUNTER > size)
            return;
        at = next;
    }
}

/* Makes the answer of the frame: bytes that differ, four at once where four follow each other. */
static void patch(const uint8_t *frame, const uint8_t *answer, uint32_t size)
{
    for (uint32_t at = 0; at < size;) {
        uint32_t run = 0;
        while (run < 4 && at + run < size && frame[at + run] != answer[at + run])
            run++;
        if (run == 4)
            store(BPF_W, (int)at, get32(answer + at));
        else if (run >= 2)
            store(BPF_H, (int)at, get16(answer + at));
        else if (run == 1)
            store(BPF_B, (int)at, answer[at]);
        at += run == 4 ? 4 : run >= 2 ? 2 : 1;
    }
}

static void answer_frame(int map, const uint8_t *frame, const uint8_t *answer, uint32_t size)
{
    expect_size(size);
    expect(BPF_H, ETHERTYPE_AT, htons(ETHERTYPE_ECAT));
    expect_datagrams(frame, size);
    patch(frame, answer, size);
    count(map, ANSWERED);
    leave(XDP_TX);
    land();
}

static void begin(void)
{
    load(BPF_W, R2, R1, offsetof(struct xdp_md, data));
    load(BPF_W, R3, R1, offsetof(struct xdp_md, data_end));
}

/* What was not answered: EtherCAT frames among it are counted. */
static void end(int map)
{
    emit(BPF_ALU64 | BPF_MOV | BPF_X, R4, R2, 0, 0);
    emit(BPF_ALU64 | BPF_ADD | BPF_K, R4, 0, 0, FIRST_DATAGRAM);
    leave_if(BPF_JMP | BPF_JGT | BPF_X, R4, R3, 0);
    expect(BPF_H, ETHERTYPE_AT, htons(ETHERTYPE_ECAT));
    count(map, PASSED);
    land();
    leave(XDP_PASS);
}

/* --- the kernel ----------------------------------------------------------------------------- */

/* Ends: with a status of its own where the kernel, or its administrator, does not want this. */
static void refused(const char *what)
{
    int status = errno == EPERM || errno == EACCES || errno == ENOSYS || errno == EOPNOTSUPP ? REFUSED
                                                                                             : 1;
    perror(what);
    exit(status);
}

static int make_counters(void)
{
    union bpf_attr attributes = {0};
    int map;
    attributes.map_type = BPF_MAP_TYPE_ARRAY;
    attributes.key_size = 4;
    attributes.value_size = COUNTERS * 8;
    attributes.max_entries = 1;
    map = bpf(BPF_MAP_CREATE, &attributes);
    if (map < 0)
        refused("responder: bpf(BPF_MAP_CREATE)");
    return map;
}

/* Loads `code`, and attaches it to an interface until this process ends. */
static void attach(const char *interface)
{
    static char said[1 << 16];
    union bpf_attr attributes = {0};
    int program;
    attributes.prog_type = BPF_PROG_TYPE_XDP;
    attributes.expected_attach_type = BPF_XDP;
    attributes.insns = (uintptr_t)code;
    attributes.insn_cnt = length;
    attributes.license = (uintptr_t) "MIT";
    program = bpf(BPF_PROG_LOAD, &attributes);
    if (program < 0 && errno == EPERM)
        refused("responder: bpf(BPF_PROG_LOAD)");
    if (program < 0) { /* once more, for what the verifier says */
        attributes.log_level = 1;
        attributes.log_size = sizeof said;
        attributes.log_buf = (uintptr_t)said;
        (void)bpf(BPF_PROG_LOAD, &attributes);
        fprintf(stderr, "%s", said);
        fail("responder: bpf(BPF_PROG_LOAD)");
    }
    memset(&attributes, 0, sizeof attributes);
    attributes.link_create.prog_fd = (uint32_t)program;
    attributes.link_create.target_ifindex = if_nametoindex(interface);
    attributes.link_create.attach_type = BPF_XDP;
    attributes.link_create.flags = XDP_FLAGS_DRV_MODE;
    if (bpf(BPF_LINK_CREATE, &attributes) < 0)
        refused("responder: bpf(BPF_LINK_CREATE)");
    length = 0;
}

static void tell(int map)
{
    uint64_t values[COUNTERS];
    uint32_t key = 0;
    union bpf_attr attributes = {0};
    attributes.map_fd = (uint32_t)map;
    attributes.key = (uintptr_t)&key;
    attributes.value = (uintptr_t)values;
    if (bpf(BPF_MAP_LOOKUP_ELEM, &attributes) < 0)
        fail("responder: bpf(BPF_MAP_LOOKUP_ELEM)");
    printf("{\"answered\": %" PRIu64 ", \"passed\": %" PRIu64 "}\n", values[ANSWERED],
           values[PASSED]);
    fflush(stdout);
}

static uint32_t read_bytes(uint8_t *to, size_t size)
{
    if (fread(to, 1, size, stdin) != size) {
        fprintf(stderr, "responder: standard input has no frames\n");
        exit(2);
    }
    return get16(to);
}

int main(int arguments, char **names)
{
    static uint8_t number[2], frame[MAX_FRAME], answer[MAX_FRAME];
    uint32_t left;
    int map;
    if (arguments != 3) {
        fprintf(stderr, "usage: responder NEAR FAR\n");
        return 2;
    }
    die_with_parent();
    map = make_counters();
    leave(XDP_PASS);
    attach(names[1]); /* veth takes back what XDP sends only where there is a program, too */
    begin();
    for (left = read_bytes(number, 2); left > 0; left--) {
        uint32_t size = read_bytes(number, 2);
        if (size > MAX_FRAME || size < FIRST_DATAGRAM + HEADER + COUNTER) {
            fprintf(stderr, "responder: a frame has %" PRIu32 " bytes\n", size);
            return 2;
        }
        (void)read_bytes(frame, size);
        (void)read_bytes(answer, size);
        answer_frame(map, frame, answer, size);
    }
    end(map);
    attach(names[2]);
    puts("ready");
    fflush(stdout);
    while (getchar() != EOF)
        tell(map);
    return 0;
}
