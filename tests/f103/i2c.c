/* Register accesses by polling, as RM0008 26.3.3 and 25.3.5 print them: a second hand beside the firmware's
 * interrupts. results[0]: command, 0 when done; results[1]: slave, results[2]: register, results[3]: how many
 * bytes to read, 0 writes results[4]; results[5]: SR1 where it failed, results[8..]: bytes. */
#include "part.h"
RESULTS;
enum { DONE, I2C, SPI };

#define I2C_CR1   REG(0x40005400)
#define I2C_CR2   REG(0x40005404)
#define I2C_DR    REG(0x40005410)
#define I2C_SR1   REG(0x40005414)
#define I2C_SR2   REG(0x40005418)
#define I2C_CCR   REG(0x4000541C)
#define I2C_TRISE REG(0x40005420)
#define SPI_CR1   REG(0x40013000)
#define SPI_SR    REG(0x40013008)
#define SPI_DR    REG(0x4001300C)
#define PE        1U
#define START     (1U << 8)
#define STOP      (1U << 9)
#define ACK       (1U << 10)
#define SB        1U
#define ADDR      2U
#define BTF       4U
#define RXNE      64U
#define TXE       128U
#define AF        (1U << 10)

/* Until a flag is there; 0 when the other end refused, or nothing came for long. */
static uint32_t await(uint32_t flag) {
    for (uint32_t i = 0; i < 20000; i++) {
        const uint32_t status = I2C_SR1;
        if (status & AF) {
            break;
        }
        if (status & flag) {
            return 1;
        }
    }
    results[5] = I2C_SR1;
    I2C_SR1 = 0;
    I2C_CR1 = PE | STOP;
    return 0;
}

static void wait_for_stop(void) {
    while (I2C_CR1 & STOP) {
    }
}

static void access_i2c(uint32_t slave, uint32_t reg, uint32_t count) {
    I2C_CR1 = PE | START;
    if (!await(SB)) {
        return;
    }
    I2C_DR = slave << 1;
    if (!await(ADDR)) {
        return;
    }
    (void)I2C_SR2;
    I2C_DR = reg;
    if (count == 0) {
        if (await(TXE)) {
            I2C_DR = results[4];
            if (await(BTF)) {
                I2C_CR1 = PE | STOP;
                wait_for_stop();
            }
        }
        return;
    }
    if (!await(BTF)) {
        return;
    }
    I2C_CR1 = PE | START | ACK;
    if (!await(SB)) {
        return;
    }
    I2C_DR = slave << 1 | 1;
    if (!await(ADDR)) {
        return;
    }
    if (count == 1) { /* EV6_3 */
        I2C_CR1 = PE;
        (void)I2C_SR2;
        I2C_CR1 = PE | STOP;
    } else {
        (void)I2C_SR2;
    }
    for (uint32_t i = 0; i < count; i++) {
        if (!await(RXNE)) {
            return;
        }
        results[8 + i] = I2C_DR;
        if (i + 2 == count) { /* EV7_1 */
            I2C_CR1 = PE | STOP;
        }
    }
    wait_for_stop();
}

static uint32_t exchange(uint32_t byte) {
    SPI_DR = byte;
    while (!(SPI_SR & 1U)) {
    }
    return SPI_DR;
}

static void access_spi(uint32_t reg, uint32_t count) {
    REG(0x40010810) = 1U << (4 + 16);
    (void)exchange(reg | (count ? 0x80U : 0U) | (count > 1 ? 0x40U : 0U));
    if (count == 0) {
        (void)exchange(results[4]);
    }
    for (uint32_t i = 0; i < count; i++) {
        results[8 + i] = exchange(0);
    }
    REG(0x40010810) = 1U << 4;
}

int main(void) {
    for (uint32_t i = 0; i < 64; i++) {
        results[i] = 0;
    }
    clock_72mhz();
    RCC_APB2ENR = 1U << 12 | 1U << 3 | 1U << 2 | 1U;
    RCC_APB1ENR = 1U << 21;
    AFIO_MAPR = 2U << 24 | 1U << 1;
    REG(0x40010810) = 1U << 4;
    GPIOA_CRL = 0x98914444U;
    REG(0x40010C04) = 0x444444DDU;
    I2C_CR2 = 36;
    I2C_CCR = 1U << 15 | 30U;
    I2C_TRISE = 11;
    I2C_CR1 = PE;
    SPI_CR1 = 1U << 9 | 1U << 8 | 1U << 6 | 3U << 3 | 7U; /* SSM, SSI, SPE, / 16, master, mode 3 */
    for (;;) {
        const uint32_t command = results[0];
        if (command == I2C) {
            access_i2c(results[1], results[2], results[3]);
            results[0] = DONE;
        } else if (command == SPI) {
            access_spi(results[2], results[3]);
            results[0] = DONE;
        }
    }
}
