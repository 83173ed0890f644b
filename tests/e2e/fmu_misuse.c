/* Calls every function for values of an FMU with all value references, values and in all states, then
 * instantiates it from damaged tables. Built with sanitizers, from the sources in the FMU.
 *
 *     fmu_misuse RESOURCES TOKEN BUS VARIABLES DAMAGED
 *
 * RESOURCES: path of the resources, TOKEN: GUID or instantiation token, VARIABLES: how many there are,
 * DAMAGED: a folder whose plant.txt this program writes.
 */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if FMI == 2
#include "fmi/fmi2Functions.h"
#define NAME(name) fmi2##name
#define EXTRA(value)
#else
#include "fmi/fmi3Functions.h"
#define NAME(name) fmi3##name
#define EXTRA(value) , value
#endif

typedef NAME(Status) status;
static unsigned long said, refused;

#if FMI == 2
static void hear(fmi2ComponentEnvironment environment, fmi2String instance, fmi2Status level,
                 fmi2String category, fmi2String format, ...) {
  char text[2000];
  va_list arguments;
  (void)environment, (void)instance, (void)level, (void)category;
  va_start(arguments, format);
  vsnprintf(text, sizeof text, format, arguments);
  va_end(arguments);
  said++;
}
static const fmi2CallbackFunctions callbacks = {hear, NULL, NULL, NULL, NULL};

static void *make(const char *resources, const char *token) {
  return fmi2Instantiate("misused", fmi2CoSimulation, token, resources, &callbacks, 0, 1);
}
static status begin(void *c) { return fmi2EnterInitializationMode(c); }
static status step(void *c, double length) { return fmi2DoStep(c, 0, length, fmi2True); }
#else
static void hear(fmi3InstanceEnvironment environment, fmi3Status level, fmi3String category,
                 fmi3String message) {
  (void)environment, (void)level, (void)category;
  said += strlen(message) > 0;
}

static void *make(const char *resources, const char *token) {
  return fmi3InstantiateCoSimulation("misused", token, resources, 0, 1, 0, 0, NULL, 0, NULL, hear, NULL);
}
static status begin(void *c) { return fmi3EnterInitializationMode(c, 0, 0, 0, 0, 0); }
static status step(void *c, double length) {
  return fmi3DoStep(c, 0, length, fmi3True, NULL, NULL, NULL, NULL);
}
#endif

static void count(int code) {
  if (code < 0 || code > 3) abort(); /* never fatal, never anything unknown */
  refused += code > 1;
}

#define TRY(Kind, Type, ...)                                                       \
  do {                                                                             \
    static const Type values[] = {__VA_ARGS__};                                    \
    size_t i;                                                                      \
    Type found;                                                                    \
    for (i = 0; i < sizeof values / sizeof *values; i++)                           \
      count(NAME(Set##Kind)(c, &reference, 1, &values[i] EXTRA(1)));               \
    count(NAME(Get##Kind)(c, &reference, 1, &found EXTRA(1)));                     \
    count(NAME(Get##Kind)(c, &reference, 1, NULL EXTRA(1)));                       \
    count(NAME(Get##Kind)(c, NULL, 1, &found EXTRA(1)));                           \
  } while (0)

/* All types at one value reference; parameters are left as they are. */
static void values(void *c, NAME(ValueReference) reference) {
#if FMI == 2
  TRY(Real, fmi2Real, 0, 1, -1e300, 1e300, 9.3e18, 1.9e19, 0.5, NAN, INFINITY, -INFINITY);
  TRY(Integer, fmi2Integer, 0, 1, -1, 2147483647, -2147483647 - 1);
  TRY(Boolean, fmi2Boolean, 0, 1, -7);
#else
  TRY(Float64, fmi3Float64, 0, 1, -1e300, 1e300, 9.3e18, 1.9e19, 0.5, NAN, INFINITY, -INFINITY);
  TRY(Boolean, fmi3Boolean, 0, 1);
  TRY(Int8, fmi3Int8, 0, 1, -1, INT8_MIN, INT8_MAX);
  TRY(UInt8, fmi3UInt8, 0, 1, UINT8_MAX);
  TRY(Int16, fmi3Int16, 0, 1, -1, INT16_MIN, INT16_MAX);
  TRY(UInt16, fmi3UInt16, 0, 1, UINT16_MAX);
  TRY(Int32, fmi3Int32, 0, 1, -1, INT32_MIN, INT32_MAX);
  TRY(UInt32, fmi3UInt32, 0, 1, UINT32_MAX);
  TRY(Int64, fmi3Int64, 0, 1, -1, INT64_MIN, INT64_MAX);
  TRY(UInt64, fmi3UInt64, 0, 1, UINT64_MAX);
#endif
}

static void strings(void *c) {
  NAME(ValueReference) reference;
  NAME(String) text = "x", none = NULL;
  for (reference = 0; reference < 4; reference++) {
    count(NAME(SetString)(c, &reference, 1, &none EXTRA(1)));
    count(NAME(GetString)(c, &reference, 1, &text EXTRA(1)));
  }
}

/* `bus` is the variable 0 or 1. Steps are not to wait, since nothing exchanges this bus. */
static void set_up(void *c, const char *bus) {
  NAME(ValueReference) name = FMI == 2 ? 0 : 1, wait = name + 1;
  NAME(Boolean) no = 0;
  if (NAME(SetString)(c, &name, 1, &bus EXTRA(1)) != 0) abort();
  if (NAME(SetBoolean)(c, &wait, 1, &no EXTRA(1)) != 0) abort();
}

static void play(const char *resources, const char *token, const char *bus, unsigned variables) {
  unsigned first = FMI == 2 ? 8 : 9, i; /* behind the parameters */
  void *c = make(resources, token);
  if (c == NULL) abort();
  set_up(c, bus);
  for (i = first; i < variables + 3; i++) values(c, i);
  count(step(c, 0.001));
  if (begin(c) != 0) abort();
  for (i = first; i < variables + 3; i++) values(c, i);
  if (NAME(ExitInitializationMode)(c) != 0) abort();
  for (i = 0; i < variables + 3; i++) values(c, i);
  strings(c);
  count(step(c, NAN));
  count(step(c, 0.001)); /* fails: nobody answers the claim */
  for (i = 0; i < variables + 3; i++) values(c, i);
  count(step(c, 0.001));
  count(NAME(Terminate)(c));
  for (i = 0; i < variables + 3; i++) values(c, i);
  count(NAME(Reset)(c));
  set_up(c, "nobody");
  count(begin(c));
  count(NAME(ExitInitializationMode)(c));
  NAME(FreeInstance)(c);
}

static char *load(const char *folder, size_t *size) {
  char path[4096], *text;
  FILE *file;
  snprintf(path, sizeof path, "%s/plant.txt", folder);
  file = fopen(path, "rb");
  if (file == NULL || fseek(file, 0, SEEK_END) != 0) abort();
  *size = (size_t)ftell(file);
  rewind(file);
  text = malloc(*size);
  if (text == NULL || fread(text, 1, *size, file) != *size) abort();
  fclose(file);
  return text;
}

static int damaged(const char *folder, const char *token, const char *text, size_t size) {
  char path[4096];
  FILE *file;
  void *c;
  snprintf(path, sizeof path, "%s/plant.txt", folder);
  file = fopen(path, "wb");
  if (file == NULL || fwrite(text, 1, size, file) != size) abort();
  fclose(file);
  c = make(folder, token);
  NAME(FreeInstance)(c);
  return c != NULL;
}

int main(int argc, char **argv) {
  static const char marks[] = {'\0', '\n', ' ', '-', '9', 'f', '\xff'};
  size_t size, i;
  unsigned accepted = 0;
  char *text;
  if (argc != 6) return 2;
  play(argv[1], argv[2], argv[3], (unsigned)atoi(argv[4]));
  text = load(argv[1], &size);
  for (i = 0; i < size; i += 1 + i / 64) {
    size_t m = i % sizeof marks;
    char before = text[i];
    if (damaged(argv[5], argv[2], text, i)) abort(); /* a table that was cut */
    text[i] = marks[m];
    accepted += damaged(argv[5], argv[2], text, size) != 0;
    text[i] = before;
  }
  free(text);
  printf("%lu messages, %lu calls refused, %u altered tables accepted\n", said, refused, accepted);
  return 0;
}
