/* Answers the frames of the cycle inside the kernel: with an XDP program on the far end of a veth
 * pair, within the system call that sends a frame. So no process has to be woken. All other frames
 * go on to the program that serves the far end.
 *
 * usage: responder NEAR FAR
 * Standard input begins with recorded frames and their answers: first their number, then for each
 * its length, the frame and the answer. Numbers have 16 bits, little-endian.
 *
 * From then on, a frame with the same datagrams (commands, addresses, lengths) gets the same
 * answer. Bytes that differ between recorded frame and answer are written: working counters, AL
 * status, inputs, the mark in the source address. All other bytes, such as outputs and indices, go
 * back unchanged.
 *
 * Prints "ready" when it answers. For each further byte on standard input, prints a line of JSON
 * with the numbers of EtherCAT frames answered and passed on. Ends when standard input is closed.
 */
#include "raw_socket.h"

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
    MOST_CODE = 30000 /* a jump offset has 16 bits */
};
enum { ANSWERED, PASSED, COUNTERS };
enum { REFUSED = 3 }; /* exit status */
enum { R0, R1, R2, R3, R4 }; /* registers; after begin(), R2 is the frame, R3 its end */

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

/* Jumps to the end of the code for one frame; land() sets their targets. */
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

/* Leaves unless the frame has this size. After this check, the verifier allows access to `size` bytes. */
static void expect_size(uint32_t size)
{
    emit(BPF_ALU64 | BPF_MOV | BPF_X, R4, R2, 0, 0);
    emit(BPF_ALU64 | BPF_ADD | BPF_K, R4, 0, 0, (int32_t)size);
    leave_if(BPF_JMP | BPF_JGT | BPF_X, R4, R3, 0);
    emit(BPF_ALU64 | BPF_MOV | BPF_X, R4, R2, 0, 0);
    emit(BPF_ALU64 | BPF_ADD | BPF_K, R4, 0, 0, (int32_t)size + 1);
    leave_if(BPF_JMP | BPF_JLE | BPF_X, R4, R3, 0);
}

/* Leaves unless each datagram has the command, address and length that it has in `frame`. */
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

/* Turns the frame into its answer: writes the bytes that differ, up to four at once. */
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

/* Passes on all other frames, and counts the EtherCAT frames among them. */
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

/* Ends the program: with the status REFUSED if the kernel or its administrator forbids this. */
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
    if (program < 0) { /* once more, to get the log of the verifier */
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
    attach(names[1]); /* veth only takes frames from XDP if this end has a program, too */
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
