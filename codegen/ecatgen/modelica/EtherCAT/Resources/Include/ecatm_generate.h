/* Runs `ecatctl generate` from inside a Modelica tool, and shows its output there. */
#ifndef ECATM_GENERATE_H
#define ECATM_GENERATE_H

#include <spawn.h>
#include <stdio.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "ModelicaUtilities.h"
#include "ecatm_system.h"

extern char **environ;

#define ECATM_OUTPUT 4096 /* bytes of the output of the program that are kept */

/* Starts a program. Its standard output and error output are read from `*output`. No shell reads the
 * arguments, so that names may have any characters. Returns 0 or an errno. */
ECATM_FUNCTION int ecatm_start(char **arguments, pid_t *child, int *output) {
  posix_spawn_file_actions_t actions;
  int ends[2], error;
  if (pipe(ends) != 0) return errno;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", 0, 0);
  posix_spawn_file_actions_adddup2(&actions, ends[1], 1);
  posix_spawn_file_actions_adddup2(&actions, ends[1], 2);
  posix_spawn_file_actions_addclose(&actions, ends[0]);
  posix_spawn_file_actions_addclose(&actions, ends[1]);
  error = posix_spawnp(child, arguments[0], &actions, NULL, arguments, environ);
  posix_spawn_file_actions_destroy(&actions);
  close(ends[1]);
  if (error != 0)
    close(ends[0]);
  else
    *output = ends[0];
  return error;
}

/* Reads to the end. Keeps the first `size` - 1 bytes in `text`, without the line feeds at the end. */
ECATM_FUNCTION void ecatm_read_all(int from, char *text, size_t size) {
  char rest[256];
  size_t used = 0;
  ssize_t got;
  for (;;) {
    int full = used + 1 >= size;
    got = full ? read(from, rest, sizeof rest) : read(from, text + used, size - 1 - used);
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) break;
    if (!full) used += (size_t)got;
  }
  while (used > 0 && text[used - 1] == '\n') used--;
  text[used] = '\0';
}

/* Generates the library `name` of a bus in the folder `path`. Any failure is an error. */
ECATM_FUNCTION void ecatm_generate(const char *program, const char *bus, const char *name,
                                   const char *path) {
  char *arguments[7];
  char text[ECATM_OUTPUT];
  pid_t child;
  int output, error, status = 0;
  if (name[0] == '-' || path[0] == '-' || bus[0] == '-') {
    ModelicaError("EtherCAT: no library was generated: its name, the folder and the bus must not "
                  "begin with '-'");
    return;
  }
  arguments[0] = (char *)program;
  arguments[1] = (char *)"--bus";
  arguments[2] = (char *)bus;
  arguments[3] = (char *)"generate";
  arguments[4] = (char *)name;
  arguments[5] = (char *)path;
  arguments[6] = NULL;
  error = ecatm_start(arguments, &child, &output);
  if (error != 0) {
    ModelicaFormatError("EtherCAT: the program '%s' cannot be started (%s); install ecatd, or give "
                        "the path of ecatctl by the input ecatctl of generateConfiguration",
                        program, strerror(error));
    return;
  }
  ecatm_read_all(output, text, sizeof text);
  close(output);
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) continue;
  if (!WIFEXITED(status) || WEXITSTATUS(status) != 0) {
    ModelicaFormatError("EtherCAT: no library was generated: %s",
                        text[0] != '\0' ? text : "ecatctl has ended without a word");
    return;
  }
  ModelicaFormatMessage("EtherCAT: %s\n", text);
  printf("EtherCAT: %s\n", text); /* OpenModelica shows messages of simulations only */
  fflush(stdout);
}

#endif
