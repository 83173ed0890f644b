/* The layout of the shared memory as text, for languages that cannot read ecat_shm.def. */
#include <ecat/ecat.h>
#include <ecat/ecat_shm.h>
#include <sched.h>
#include <stddef.h>
#include <stdio.h>

static struct {
  char chars[65536]; /* large enough: a test compares the text with the definition */
  size_t used;
} text;

#define ROW(...)                                                                        \
  do {                                                                                  \
    int n = snprintf(text.chars + text.used, sizeof text.chars - text.used, __VA_ARGS__); \
    if (n > 0 && (size_t)n < sizeof text.chars - text.used) text.used += (size_t)n;     \
  } while (0)

static void write_constants(void) {
#define ECAT_CONST(name, comment) \
  ROW("const - %s - %llu - - %s\n", #name, (unsigned long long)(name), comment);
#include <ecat/ecat_shm.def>
}

static void write_enumerations(void) {
  const char *of = "";
#define ENUM_ROW(name, comment) \
  of = #name;                   \
  ROW("enum %s - - - - - %s\n", of, comment);
#define VALUE_ROW(name, value, comment) ROW("value %s %s - %d - - %s\n", of, #name, value, comment);
#define ECAT_ENUM(name, comment) ENUM_ROW(name, comment)
#define ECAT_FIRST(name, value, comment) VALUE_ROW(name, value, comment)
#define ECAT_VALUE(name, value, comment) VALUE_ROW(name, value, comment)
#include <ecat/ecat_shm.def>
#define ECAT_ENUM(name, comment) ENUM_ROW(name, comment)
#define ECAT_FIRST(name, value, comment) VALUE_ROW(name, value, comment)
#define ECAT_VALUE(name, value, comment) VALUE_ROW(name, value, comment)
#include <ecat/ecat.def>
}

static void write_structs(void) {
  /* A scope per struct: within it, `self` is the struct that the fields belong to. */
#define ECAT_STRUCT(name, comment)                                               \
  {                                                                         \
    typedef name self;                                                      \
    const char *of = #name;                                                 \
    ROW("struct %s - - - %zu - %s\n", of, sizeof(self), comment);
#define ECAT_FIELD(type, field, count, comment)                                         \
    ROW("field %s %s %s %zu %zu %d %s\n", of, #field, #type, offsetof(self, field), \
        sizeof(((self *)0)->field), count, comment);
#define ECAT_END(name) }
#include <ecat/ecat_shm.def>
}

static void write_counters(void) {
  const char *of = "";
#define ECAT_STRUCT(name, comment) of = #name;
#define ECAT_COUNTER(name, unit, severity, comment) \
  ROW("counter %s %s %s - - - %s\n", of, #name, #unit, #severity);
#include <ecat/ecat_shm.def>
}

const char *ecat_layout(void) {
  static int state; /* 1: the text is being written, 2: it is complete */
  int none = 0;
  if (__atomic_compare_exchange_n(&state, &none, 1, 0, __ATOMIC_ACQUIRE, __ATOMIC_ACQUIRE)) {
    write_constants();
    write_enumerations();
    write_structs();
    write_counters();
    __atomic_store_n(&state, 2, __ATOMIC_RELEASE);
  }
  while (__atomic_load_n(&state, __ATOMIC_ACQUIRE) != 2) sched_yield();
  return text.chars;
}
