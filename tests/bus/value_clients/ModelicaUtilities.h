/* A Modelica tool whose simulation goes on after an error, with what stands after setjmp(refused). */
#ifndef MODELICA_UTILITIES_H
#define MODELICA_UTILITIES_H

#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

static jmp_buf refused;

static void ModelicaFormatMessage(const char *format, ...) { (void)format; }
static void ModelicaFormatError(const char *format, ...) {
  va_list arguments;
  va_start(arguments, format);
  vfprintf(stderr, format, arguments);
  va_end(arguments);
  fputc('\n', stderr);
  longjmp(refused, 1);
}
static void ModelicaError(const char *text) { ModelicaFormatError("%s", text); }
static char *ModelicaAllocateString(size_t length) { return (char *)malloc(length + 1); }

#endif
