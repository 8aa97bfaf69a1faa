/* Text to whoever debugs the processor, by semihosting: put a UART here on a board. */
#ifndef CONSOLE_H
#define CONSOLE_H

#include <stdint.h>

void console_text(const char *text);
void console_number(int32_t x);

/* Ends the program; code 0 is success. */
void console_exit(int code);

#endif
