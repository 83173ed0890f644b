/* The shared memory of a bus: constants, enumerations and structs. They come from ecat_shm.def, which
 * defines the meaning and the writer of each of them. docs/shared-memory.md has the same as tables,
 * and explains how readers and writers work together.
 *
 * C89-clean. Programs use ecat.h; this header is for the daemon, for tools, and for clients in other
 * languages.
 *
 * Versions. A new minor version may
 *   - append fields to ecat_shm_header and ecat_shm_health,
 *   - add tables, whose offsets are appended to the header,
 *   - add enumerators, and entries to the ecat_shm_setting table,
 *   - give a meaning to a field `pad...`, where 0 means the old behaviour.
 * It never changes the size of a table entry, of a part of a slot or of a page, nor the meaning of a
 * field. Any other change needs a new major version. Magic number, layout number and the byte of the
 * lock keep their places in all versions, so that every client can report why a daemon does not fit.
 *
 * A client accepts a daemon of its own major version and of its own or a later minor version. It
 * therefore finds tables only by their offsets, treats an unknown enumerator as "something else", and
 * ignores every `pad...`. An earlier minor version lacks parts that the client needs, and another major
 * version may have any layout: both are refused, with an error text that says which side to update.
 */
#ifndef ECAT_SHM_H
#define ECAT_SHM_H

#include <stdint.h>

#define ECAT_ENUM(name, comment) enum name {
#define ECAT_FIRST(name, value, comment) name = value
#define ECAT_VALUE(name, value, comment) , name = value
#define ECAT_END_ENUM(name) };
#define ECAT_STRUCT(name, comment) typedef struct name {
#define ECAT_FIELD(type, name, count, comment) ECAT_FIELD_##count(type, name)
#define ECAT_FIELD_1(type, name) type name;
#define ECAT_FIELD_2(type, name) type name[2];
#define ECAT_FIELD_3(type, name) type name[3];
#define ECAT_FIELD_4(type, name) type name[4];
#define ECAT_FIELD_8(type, name) type name[8];
#define ECAT_FIELD_16(type, name) type name[16];
#define ECAT_FIELD_32(type, name) type name[32];
#define ECAT_FIELD_64(type, name) type name[64];
#define ECAT_FIELD_512(type, name) type name[512];
#define ECAT_FIELD_928(type, name) type name[928];
#define ECAT_END(name) } name;
#include "ecat_shm.def"

#if defined(__GNUC__)
#define ECAT_SHM_API __attribute__((visibility("default")))
#else
#define ECAT_SHM_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* The layout of the shared memory and the enumerations of ecat.h as text, from which other languages
 * build their view of the memory. Each line has seven words, with "-" in place of a missing word, and
 * then a comment; that of a counter is its severity, and the rest about it is in the line of its field:
 *
 *     const    -       name  -     value   -     -
 *     enum     name    -     -     -       -     -
 *     value    of      name  -     value   -     -
 *     struct   name    -     -     -       size  -
 *     field    struct  name  type  offset  size  count
 *     counter  struct  name  unit  -       -     -
 */
ECAT_SHM_API const char *ecat_layout(void);

/* The bucket of a time in ns, and the smallest time of a bucket. Times of 2^33 ns (8.6 s) and more share
 * the last bucket. */
ECAT_SHM_API unsigned ecat_histogram_bucket(uint64_t ns);
ECAT_SHM_API uint64_t ecat_histogram_bound(unsigned bucket);
/* The time in ns that the share `q` (0 to 1) of all samples does not exceed; 0 if there are none. */
ECAT_SHM_API uint64_t ecat_histogram_quantile(const ecat_shm_histogram *histogram, double q);

/* Sizes of the texts of the following calls. */
#define ECAT_SHM_PATH 64
#define ECAT_SHM_TEXT 512

/* The folders in which this process looks for a bus, `number` from 0: that of its user, that of the user in
 * ECAT_TRUSTED_OWNER, and that of the machine. A daemon of this user makes its files in number 0. Returns 0,
 * or -1 if there is no such number. */
ECAT_SHM_API int ecat_shm_folder(unsigned number, char folder[ECAT_SHM_PATH]);

/* Opens a file of a bus in one of these folders: `ecat0`, or `ecat0.out`. It is opened only if folder and file
 * belong to root, the user `ecatd`, the user of this process or that in ECAT_TRUSTED_OWNER, and nobody else can
 * write into the folder. Returns a file descriptor, or ECAT_EDOWN: there is no such file; ECAT_EPERM with an
 * empty text: this user may not open it; or another ecat_errno with its text. It never waits. */
ECAT_SHM_API int ecat_shm_open(const char *folder, const char *name, int writable,
                               char text[ECAT_SHM_TEXT]);

/* Opens a bus, read-only, in the first folder in which a daemon serves it; else what a killed daemon has left.
 * Returns as ecat_shm_open(). */
ECAT_SHM_API int ecat_shm_find(const char *bus, char folder[ECAT_SHM_PATH], char text[ECAT_SHM_TEXT]);

#ifdef __cplusplus
}
#endif

#endif
