/* Way into the ROM bootloader: board_enter_bootloader() of app/board.h. */
#ifndef PLUMB_STM32F103_BOOTLOADER_H
#define PLUMB_STM32F103_BOOTLOADER_H

/* By the reset handler, before it touches memory: does not return when the bootloader was asked for. */
void bootloader_if_asked(void);

#endif
