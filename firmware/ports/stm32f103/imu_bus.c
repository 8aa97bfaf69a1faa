/* What the buses of gyro and accelerometer raise. */
#include "imu.h"
#include "spi.h"

void imu_init(void) {
    i2c_init();
    spi_init();
}

/* The last byte was received. */
void spi_dma_handler(void) {
    spi_end();
    imu_transferred(TRANSFER_DONE);
}

static void i2c_advanced(transfer_t result) {
    if (result != TRANSFER_UNDER_WAY) {
        imu_transferred(result);
    }
}

void i2c_event_handler(void) {
    i2c_advanced(i2c_on_event());
}

void i2c_error_handler(void) {
    i2c_advanced(i2c_on_error());
}

void i2c_dma_handler(void) {
    i2c_advanced(i2c_on_dma());
}
