/* What all of these programs share. They write values, one after the other, and say what became of
 * each: the code of the client, and the bits that the entry has in the last commit of this process.
 * Then they say "done", and keep their outputs until their input ends.
 *
 * Arguments: bus; rounding mode (N, U, D, Z); file with a line for each value: number of the entry,
 * kind of the value (r: raw, i: raw integer, p: physical), value. */
#ifndef COMMITTED_H
#define COMMITTED_H

#include <ecat/ecat.h>

#include <fcntl.h>
#include <fenv.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

/* The segment of the clients, as docs/shared-memory.md describes it. */
static const unsigned char *out_segment(const char *bus) {
  char folder[ECAT_SHM_PATH], path[ECAT_SHM_PATH + 40];
  struct stat found;
  void *map;
  int fd;
  (void)ecat_shm_folder(0, folder);
  snprintf(path, sizeof path, "%s/%s.out", folder, bus);
  fd = open(path, O_RDONLY);
  if (fd < 0 || fstat(fd, &found) != 0) exit(20);
  map = mmap(NULL, (size_t)found.st_size, PROT_READ, MAP_SHARED, fd, 0);
  if (map == MAP_FAILED) exit(21);
  return (const unsigned char *)map;
}

/* The bits of an output in the last commit of this process; there is one domain, and one client. */
static unsigned long long committed(const unsigned char *out, const ecat_signal_info *entry) {
  const ecat_out_header *header = (const ecat_out_header *)out;
  unsigned long long bits = 0;
  unsigned n, i;
  for (n = 0; n < header->slot_count; n++) {
    const ecat_out_doorbell *bell = (const ecat_out_doorbell *)(out + header->doorbells_offset) + n;
    const unsigned char *slot = out + header->slots_offset + (size_t)n * header->slot_stride;
    const unsigned char *image = slot + header->images_offset +
                                 (size_t)(bell->commit_seq % ECAT_IMAGES) * header->image_stride;
    const ecat_out_image *head = (const ecat_out_image *)image;
    if (bell->generation == 0 || ((const ecat_out_slot *)slot)->pid != (unsigned)getpid()) continue;
    image += sizeof *head + head->bytes;
    for (i = entry->bit_length; i-- > 0;) {
      unsigned bit = entry->bit_offset + i - 8 * head->first;
      bits = bits << 1 | (image[bit / 8] >> (bit % 8) & 1u);
    }
    return bits;
  }
  exit(22);
}

static FILE *values;

/* Opens the file with the values, and sets the rounding mode. */
static void begin(char **argv) {
  const char *mode = argv[2];
  values = fopen(argv[3], "r");
  if (values == NULL) exit(23);
  fesetround(*mode == 'U'   ? FE_UPWARD
             : *mode == 'D' ? FE_DOWNWARD
             : *mode == 'Z' ? FE_TOWARDZERO
                            : FE_TONEAREST);
}

/* The next line of input, or 0. Numbers are read to the nearest, whatever the program rounds to. */
static int next_value(int *number, char *kind, double *real, unsigned long long *whole) {
  char text[64];
  int mode = fegetround();
  fesetround(FE_TONEAREST);
  if (fscanf(values, "%d %c %63s", number, kind, text) != 3) return 0;
  *real = *kind == 'i' ? 0 : strtod(text, NULL);
  *whole = *kind != 'i'     ? 0
           : text[0] == '-' ? (unsigned long long)strtoll(text, NULL, 10)
                            : strtoull(text, NULL, 10);
  fesetround(mode);
  return 1;
}

/* Keeps what was written until the input ends. */
static void end(void) {
  puts("done");
  fflush(stdout);
  while (getchar() != EOF) continue;
}

#endif
