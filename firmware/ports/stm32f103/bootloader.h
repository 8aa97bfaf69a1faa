/* Entry into the ROM bootloader: bootloader.c implements board_enter_bootloader(). */
#ifndef PLUMB_STM32F103_BOOTLOADER_H
#define PLUMB_STM32F103_BOOTLOADER_H

/* Call from the reset handler, before it touches memory: does not return when the bootloader was asked for.
 */
void bootloader_if_asked(void);

#endif
