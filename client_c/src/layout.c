/* The layout as text, for languages that cannot read ecat_shm.def. */
#include <ecat/ecat_shm.h>
#include <stddef.h>
#include <stdio.h>

struct text {
  char chars[32768];
  size_t used;
};

static void row(struct text *text, const char *structure, const char *field, const char *type,
                size_t offset, size_t size, size_t count) {
  int n = snprintf(text->chars + text->used, sizeof text->chars - text->used,
                   "%s %s %s %zu %zu %zu\n", structure, field, type, offset, size, count);
  if (n > 0) text->used += (size_t)n;
}

/* One function per struct: within it, `self` is the struct that the fields belong to. */
#define STRUCT(name, comment)                    \
  static void rows_of_##name(struct text *text) { \
    typedef name self;                           \
    static const char structure[] = #name;       \
    row(text, structure, "-", "-", 0, sizeof(self), 1);
#define FIELD(type, field, count, comment)                 \
  row(text, structure, #field, #type, offsetof(self, field), \
      sizeof(((self *)0)->field), count);
#define END(name) }
#include <ecat/ecat_shm.def>
#undef STRUCT
#undef FIELD
#undef END

const char *ecat_layout(void) {
  static struct text text;
  if (text.used == 0) {
#define STRUCT(name, comment) rows_of_##name(&text);
#define FIELD(type, field, count, comment)
#define END(name)
#include <ecat/ecat_shm.def>
#undef STRUCT
#undef FIELD
#undef END
  }
  return text.chars;
}
