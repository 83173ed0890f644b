/* The functions of ModelicaUtilities.h that ecat_modelica.h uses, for programs without a Modelica
 * tool: an error is printed and ends the program through exit(), so that atexit() functions run.
 * Modelica tools bring their own file of this name; this one lies outside their search path.
 */
#ifndef MODELICA_UTILITIES_H
#define MODELICA_UTILITIES_H

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#if defined(__GNUC__)
#define MODELICA_STANDALONE static __attribute__((unused))
#else
#define MODELICA_STANDALONE static
#endif

MODELICA_STANDALONE void ModelicaFormatMessage(const char *format, ...) {
  va_list arguments;
  va_start(arguments, format);
  vfprintf(stderr, format, arguments);
  va_end(arguments);
}

MODELICA_STANDALONE void ModelicaFormatError(const char *format, ...) {
  va_list arguments;
  va_start(arguments, format);
  vfprintf(stderr, format, arguments);
  va_end(arguments);
  fputc('\n', stderr);
  exit(EXIT_FAILURE);
}

MODELICA_STANDALONE void ModelicaError(const char *text) { ModelicaFormatError("%s", text); }

/* The memory is never freed: no tool knows when a text is no longer used. */
MODELICA_STANDALONE char *ModelicaAllocateString(size_t length) {
  char *text = (char *)malloc(length + 1);
  if (text == NULL) ModelicaError("out of memory");
  else text[length] = '\0';
  return text;
}

#endif
