/* Many readers of the shared memory: each waits for every cycle and samples the process image.
 *
 * usage: readers BUS COUNT
 * Each reader is a process of its own. The first byte on standard input starts the readers; each
 * further byte stops them, or lets them go on. The program ends when standard input is closed.
 */
#include <ecat/ecat.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

enum { MOST = 1000 };

static int read_forever(const char *name)
{
    ecat_t *bus;
    if (ecat_open(&bus, name) != 0) {
        fprintf(stderr, "readers: %s\n", ecat_error(bus));
        return 1;
    }
    for (;;)
        if (ecat_wait(bus, 1, 1.0) == 0)
            (void)ecat_sample(bus);
}

int main(int count, char **arguments)
{
    static pid_t readers[MOST];
    int wanted = count == 3 ? atoi(arguments[2]) : 0, i, running = 0;
    if (wanted < 1 || wanted > MOST) {
        fprintf(stderr, "usage: readers BUS COUNT\n");
        return 2;
    }
    for (i = 0; i < wanted; i++) {
        readers[i] = fork();
        if (readers[i] < 0) {
            perror("fork");
            return 1;
        }
        if (readers[i] == 0) {
            (void)prctl(PR_SET_PDEATHSIG, SIGKILL);
            raise(SIGSTOP);
            return read_forever(arguments[1]);
        }
    }
    while (getchar() != EOF) {
        running = !running;
        for (i = 0; i < wanted; i++)
            kill(readers[i], running ? SIGCONT : SIGSTOP);
    }
    for (i = 0; i < wanted; i++)
        kill(readers[i], SIGKILL);
    return 0;
}
