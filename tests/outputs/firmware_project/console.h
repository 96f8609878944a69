/* Text out of the program, on a host and on a core under a debugger. */
#ifndef CONSOLE_H
#define CONSOLE_H

#include <stdint.h>

void print_text(const char *text);
void print_hex(const char *label, uint32_t word);

#endif
