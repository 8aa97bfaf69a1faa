/* I2C1 as master: one register access at a time; the caller limits its time. The functions of the interrupts
 * (i2c_on_...) return how the access ended. */
#ifndef PLUMB_STM32F103_I2C_H
#define PLUMB_STM32F103_I2C_H

#include <stdbool.h>
#include <stdint.h>

/* How an access to a chip ended. */
typedef enum {
    TRANSFER_UNDER_WAY,
    TRANSFER_DONE,
    TRANSFER_REFUSED, /* no chip answered to the address */
    TRANSFER_FAILED   /* the bus did not behave; it is reset */
} transfer_t;

/* After clock_init(). */
void i2c_init(void);

/* Start an access to the registers of a chip from `reg` on: read to_read bytes into data, or with 0 write one
 * byte from data. */
void i2c_access(uint8_t address, uint8_t reg, uint8_t *data, uint32_t to_read);

/* Reset the peripheral and drop the access; i2c_recover() then starts from its beginning. */
void i2c_abort(void);

/* Clear the bus, half a clock pulse with each call. Call every millisecond until it returns true. */
bool i2c_recover(void);

transfer_t i2c_on_event(void);
transfer_t i2c_on_error(void);
transfer_t i2c_on_dma(void);

#endif
