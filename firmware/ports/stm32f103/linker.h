/* Addresses from the linker script. */
#ifndef PLUMB_STM32F103_LINKER_H
#define PLUMB_STM32F103_LINKER_H

#include <stdint.h>

extern uint32_t data_load[], data_start[], data_end[], bss_start[], bss_end[];
extern uint32_t stack_guard[], stack_top[];   /* guard: faults.c; the stack grows down towards it */
extern uint32_t ram_end[];                    /* end of all variables */
extern uint32_t image_start[], image_bytes[]; /* the address of image_bytes is the size of the image */
extern const uint8_t image_crc_address[];
extern const uint32_t guarded_start[], guarded_end[];
extern const uint32_t guarded_parameters_start[], guarded_parameters_end[];
extern volatile uint16_t store_start[];

#endif
