/* The bare echo, with which the simulator is compared: receives a frame, marks it, sends it back.
 *
 * usage: echo INTERFACE      (prints "ready" when it answers, and runs until it is killed)
 */
#include "raw_socket.h"

enum { PRIORITY = 85, STOP_POLL_US = 20000, PROCESSED_MARK = 0x02 };

int main(int count, char **arguments)
{
    static uint8_t frame[MAX_FRAME];
    if (count != 2) {
        fprintf(stderr, "usage: echo INTERFACE\n");
        return 2;
    }
    die_with_parent();
    int fd = open_raw_socket(arguments[1], STOP_POLL_US);
    ask_for_real_time(PRIORITY);
    puts("ready");
    fflush(stdout);
    for (;;) {
        ssize_t size = recv(fd, frame, sizeof frame, MSG_TRUNC);
        if (size < 14 || (size_t)size > sizeof frame)
            continue;
        frame[6] |= PROCESSED_MARK;
        (void)send(fd, frame, (size_t)size, MSG_DONTWAIT);
    }
}
