/* usage: torn read|commit|hurry|broken-read|broken-commit BYTES COUNT
 *
 * Whether any reader gets an image of two cycles, and the engine outputs of two commits. */
#include "torn.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

int main(int count, char **arguments) {
  static struct bench bench;
  const char *what = count == 4 ? arguments[1] : "";
  bench.broken = strncmp(what, "broken-", 7) == 0;
  if (bench.broken) what += 7;
  bench.hurry = strcmp(what, "hurry") == 0;
  if (bench.hurry) what = "commit";
  if (strcmp(what, "read") != 0 && strcmp(what, "commit") != 0) {
    fputs("usage: torn read|commit|hurry|broken-read|broken-commit BYTES COUNT\n", stderr);
    return 2;
  }
  bench.size = (uint32_t)strtoul(arguments[2], NULL, 10);
  bench.count = strtoull(arguments[3], NULL, 10);
  snprintf(bench.name, sizeof bench.name, "torn%d", (int)getpid());
  files_make(&bench);
  if (strcmp(what, "read") == 0)
    read_images(&bench);
  else
    take_commits(&bench);
  cyclic_free(bench.engine);
  files_remove();
  return 0;
}
