/* Where the shared memory of a bus lies, and whom a client believes that it is the memory of a bus.
 * docs/shared-memory.md describes the rule. The daemon and the readers in Python use it from here. */
#include "internal.h"

#include <errno.h>
#include <fcntl.h>
#include <pwd.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define MACHINE "/dev/shm/ecat" /* of root and of the service, whose user has this name: */
#define SERVICE "ecatd"
#define SESSIONS "/run/user" /* has a directory of each user who has logged in, where nobody else can be first */
#define SETTING "ECAT_TRUSTED_OWNER" /* a user whom the clients of this process believe as well */
#define NOBODY ((uid_t)-1)
#define REMADE ": remove it; the next start of ecatd makes it again"

enum { ROWS = 8 };

struct row {
  unsigned inside, outside, count;
};

__attribute__((format(printf, 3, 4))) static int explain(char *text, int code, const char *format, ...) {
  va_list values;
  va_start(values, format);
  vsnprintf(text, ECAT_SHM_TEXT, format, values);
  va_end(values);
  return code;
}

/* The users of this user namespace: how many ranges, or -1 if that is unknown. The kernel shows the files of all
 * others as those of one user, 65534. */
static int read_users(struct row rows[ROWS]) {
  FILE *map = fopen("/proc/self/uid_map", "re");
  int n = 0;
  if (map == NULL) return -1;
  while (n < ROWS && fscanf(map, "%u %u %u", &rows[n].inside, &rows[n].outside, &rows[n].count) == 3) n++;
  fclose(map);
  return n;
}

static int is_in_namespace(uid_t user) {
  struct row rows[ROWS];
  int i, n = read_users(rows);
  for (i = 0; i < n; i++)
    if (user >= rows[i].inside && user - rows[i].inside < rows[i].count) return 1;
  return n < 0 || n == ROWS;
}

/* The user of this process. Root in a namespace with one user is the ordinary user who has made it, as
 * `ecatsim` does for its network, and has the folder of that user. */
static uid_t real_user(void) {
  struct row rows[ROWS];
  if (geteuid() != 0 || read_users(rows) != 1 || rows[0].inside != 0 || rows[0].count != 1)
    return geteuid();
  return rows[0].outside;
}

/* The number of a user, or NOBODY. */
static uid_t user_named(const char *name) {
  char buffer[4096];
  struct passwd entry, *found = NULL;
  return getpwnam_r(name, &entry, buffer, sizeof buffer, &found) == 0 && found != NULL ? entry.pw_uid
                                                                                     : NOBODY;
}

/* Reads the setting; returns an error code if it names nobody. */
static int read_setting(uid_t *user, char *text) {
  const char *value = secure_getenv(SETTING);
  char *end;
  unsigned long number;
  *user = NOBODY;
  if (value == NULL || value[0] == '\0') return 0;
  number = strtoul(value, &end, 10);
  if (value[0] >= '0' && value[0] <= '9' && *end == '\0' && number < NOBODY)
    *user = (uid_t)number;
  else if ((*user = user_named(value)) == NOBODY)
    return explain(text, ECAT_EARG,
                   SETTING " is '%.64s', which is no user of this machine: give a name that 'getent "
                           "passwd' shows, or a number",
                   value);
  return 0;
}

static void folder_of(uid_t user, char folder[ECAT_SHM_PATH]) {
  if (user == 0 || user == user_named(SERVICE))
    snprintf(folder, ECAT_SHM_PATH, MACHINE);
  else
    snprintf(folder, ECAT_SHM_PATH, MACHINE "-%u", (unsigned)user);
}

int ecat_shm_folder(unsigned number, char folder[ECAT_SHM_PATH]) {
  char own[ECAT_SHM_PATH], text[ECAT_SHM_TEXT];
  uid_t trusted, user = real_user();
  folder_of(user, own);
  strcpy(folder, own);
  if (number == 0) return 0;
  snprintf(folder, ECAT_SHM_PATH, SESSIONS "/%u/ecat", (unsigned)user);
  if (strcmp(own, MACHINE) != 0 && --number == 0) return 0;
  if (read_setting(&trusted, text) == 0 && trusted != NOBODY) {
    folder_of(trusted, folder);
    if (strcmp(folder, own) != 0 && strcmp(folder, MACHINE) != 0 && --number == 0) return 0;
  }
  strcpy(folder, MACHINE);
  return strcmp(own, MACHINE) != 0 && number == 1 ? 0 : -1;
}

static int is_believed(uid_t owner, uid_t trusted) {
  if (owner == trusted) return 1;
  return is_in_namespace(owner) &&
         (owner == 0 || owner == geteuid() || owner == user_named(SERVICE));
}

static int refuse(const char *path, uid_t owner, char *text) {
  char buffer[4096], name[64] = "";
  struct passwd entry, *found = NULL;
  if (!is_in_namespace(owner))
    snprintf(name, sizeof name, ", which stands for all users outside of this container");
  else if (getpwuid_r(owner, &entry, buffer, sizeof buffer, &found) == 0 && found != NULL)
    snprintf(name, sizeof name, " (%.32s)", entry.pw_name);
  return explain(text, ECAT_EPERM,
                 "%s belongs to user %u%s, and not to root, the user '" SERVICE
                 "' or you: what it says about a bus may be invented; if you trust that user, set "
                 SETTING "=%u",
                 path, (unsigned)owner, name, (unsigned)owner);
}

/* Opens a folder as a place for names; ECAT_EDOWN: there is none. */
static int open_folder(const char *folder, uid_t trusted, char *text) {
  struct stat status;
  int fd = open(folder, O_PATH | O_NOFOLLOW | O_CLOEXEC), code = 0;
  if (fd < 0 && (errno == ENOENT || errno == EACCES)) return ECAT_EDOWN; /* EACCES: above it */
  if (fd < 0 || fstat(fd, &status) != 0)
    code = explain(text, ECAT_ESYS, "cannot open %s: %s", folder, strerror(errno));
  else if (!is_believed(status.st_uid, trusted))
    code = refuse(folder, status.st_uid, text);
  else if (!S_ISDIR(status.st_mode))
    code = explain(text, ECAT_ELAYOUT, "%s is no directory" REMADE, folder);
  else if (status.st_mode & (S_IWGRP | S_IWOTH))
    code = explain(text, ECAT_EPERM,
                   "others than its owner can write into %s, so what lies there may be invented: "
                   "'chmod go-w %s'",
                   folder, folder);
  if (code == 0) return fd;
  if (fd >= 0) close(fd);
  return code;
}

int ecat_shm_open(const char *folder, const char *name, int writable, char text[ECAT_SHM_TEXT]) {
  char path[ECAT_SHM_PATH + 64];
  struct stat status;
  uid_t trusted;
  int place, fd, code = read_setting(&trusted, text);
  if (code != 0) return code;
  place = open_folder(folder, trusted, text);
  if (place < 0) return place;
  snprintf(path, sizeof path, "%s/%s", folder, name);
  /* O_NONBLOCK: to open a FIFO must not wait for somebody at its other end. */
  fd = openat(place, name, (writable ? O_RDWR : O_RDONLY) | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
  code = errno;
  close(place);
  if (fd < 0 && code == ENOENT) return ECAT_EDOWN;
  text[0] = '\0';
  if (fd < 0 && code == EACCES) return ECAT_EPERM;
  if (fd < 0 && code == ELOOP) return explain(text, ECAT_ELAYOUT, "%s is a link" REMADE, path);
  if (fd < 0) return explain(text, ECAT_ESYS, "cannot open %s: %s", path, strerror(code));
  if (fstat(fd, &status) != 0)
    code = explain(text, ECAT_ESYS, "cannot open %s: %s", path, strerror(errno));
  else if (!is_believed(status.st_uid, trusted))
    code = refuse(path, status.st_uid, text);
  else if (!S_ISREG(status.st_mode))
    code = explain(text, ECAT_ELAYOUT, "%s is no file" REMADE, path);
  else
    return fd;
  close(fd);
  return code;
}

int ecat_shm_find(const char *name, char folder[ECAT_SHM_PATH], char text[ECAT_SHM_TEXT]) {
  char here[ECAT_SHM_PATH], why[ECAT_SHM_TEXT];
  int found = ECAT_EDOWN, fd;
  unsigned i;
  for (i = 0; ecat_shm_folder(i, here) == 0; i++) {
    fd = ecat_shm_open(here, name, 0, why);
    if (fd == ECAT_EDOWN) continue;
    if (fd >= 0 && ecat_daemon_lives(fd)) {
      if (found >= 0) close(found);
      strcpy(folder, here);
      return fd;
    }
    if (found == ECAT_EDOWN || (fd >= 0 && found < 0)) { /* a leftover says more than an error */
      found = fd;
      strcpy(folder, here);
      if (fd < 0) strcpy(text, why);
    } else if (fd >= 0) {
      close(fd);
    }
  }
  return found;
}
