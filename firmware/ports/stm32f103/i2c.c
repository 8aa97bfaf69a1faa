/* I2C1 as master on PB8 (SCL) and PB9 (SDA), one register access of a slave at a time
 * (RM0008 26.3.3, 26.3.7).
 *
 * Interrupts do all the work, and only on events that hold the clock line until they are answered (SB, ADDR,
 * BTF), so that a late interrupt cannot lose or double a byte. DMA stores received bytes; at its end of
 * transfer the hardware answers the last byte with NACK (LAST). A single byte gets its NACK because ACK is
 * cleared before ADDR. This avoids the errata "some software events must be managed before the current byte
 * is being transferred" and "wrong data read into data register" (ES096, ES0340: I2C).
 *
 * The caller limits the time of an access and calls i2c_abort(). Then i2c_recover() clears the bus: at most
 * nine clocks free a slave that holds SDA in the middle of a byte; a START, which every slave obeys at any
 * time, and a STOP follow, then a reset of the peripheral. The same edges unlock the analog filters that may
 * hold BUSY after power-up, and the reset (SWRST) is the workaround for "start cannot be generated after a
 * misplaced stop" (same errata). */
#include "i2c.h"
#include "clock.h"
#include "nvic.h"
#include "pins.h"
#include "stm32f103.h"

#define SPEED_KHZ     400U
#define RISE_NS       300U /* of fast mode, at most */
#define STOP_POLLS    32U  /* a STOP takes a clock of the bus, 2.5 us: about 3 polls */
#define SCL           8U
#define SDA           9U
#define RECOVER_START 19U /* half clocks of recovery: 1 to 18 free SDA, then START and STOP */
#define RECOVER_STOP  20U

typedef enum { IDLE, START, ADDRESS, REGISTER, VALUE, RESTART, READ_ADDRESS, DATA } state_t;

static volatile state_t state;
static uint8_t address, reg;
static uint8_t *bytes;
static uint32_t count; /* bytes to read; 0: write one */
static uint32_t pclk1_mhz;
static uint32_t recover_step;

static void reset(void) {
    state = IDLE;
    DMA1_CCR7 = 0U;
    DMA1_IFCR = DMA1_IFCR_CGIF7;
    I2C1_CR1 = I2C1_CR1_SWRST;
    I2C1_CR1 = 0U;
    I2C1_CR2 = pclk1_mhz;
    I2C1_CCR =
        I2C1_CCR_F_S | ((pclk1_mhz * 1000U + 3U * SPEED_KHZ - 1U) / (3U * SPEED_KHZ)); /* low 2, high 1 */
    I2C1_TRISE = pclk1_mhz * RISE_NS / 1000U + 1U;
    I2C1_CR1 = I2C1_CR1_PE;
}

void i2c_init(void) {
    RCC_APB1ENR |= RCC_APB1ENR_I2C1EN;
    pclk1_mhz = clock_pclk1_mhz();
    DMA1_CPAR7 = (uint32_t)(uintptr_t)&I2C1_DR;
    nvic_enable(IRQ_I2C1_EV);
    nvic_enable(IRQ_I2C1_ER);
    nvic_enable(IRQ_DMA1_Channel7);
    reset();
}

void i2c_access(uint8_t slave, uint8_t at, uint8_t *data, uint32_t to_read) {
    address = (uint8_t)(slave << 1);
    reg = at;
    bytes = data;
    count = to_read;
    state = START;
    memory_fence(); /* the variables and the byte to write are in memory before the interrupts use them */
    I2C1_CR2 = pclk1_mhz | I2C1_CR2_ITEVTEN | I2C1_CR2_ITERREN;
    I2C1_CR1 = I2C1_CR1_PE | I2C1_CR1_START;
}

/* Sends STOP; no register may be written until it is out (RM0008 26.6.1). */
static transfer_t finish(transfer_t result) {
    I2C1_CR2 = pclk1_mhz;
    I2C1_CR1 = I2C1_CR1_PE | I2C1_CR1_STOP;
    if (!clock_wait(&I2C1_CR1, I2C1_CR1_STOP, 0U, STOP_POLLS)) {
        reset();
        result = TRANSFER_FAILED;
    }
    state = IDLE;
    return result;
}

static void receive(void) {
    DMA1_CMAR7 = (uint32_t)(uintptr_t)bytes;
    DMA1_CNDTR7 = count;
    DMA1_CCR7 = DMA1_CCR1_EN | DMA1_CCR1_MINC | DMA1_CCR1_TCIE | DMA1_CCR1_PL_HIGH;
    I2C1_CR2 = pclk1_mhz | I2C1_CR2_ITEVTEN | I2C1_CR2_ITERREN | I2C1_CR2_DMAEN | I2C1_CR2_LAST;
    I2C1_CR1 = I2C1_CR1_PE | (count > 1U ? I2C1_CR1_ACK : 0U);
}

/* An event of another state is a flag that is still being cleared: ignored, the interrupt comes again. */
transfer_t i2c_on_event(void) {
    const uint32_t event = I2C1_SR1;
    switch (state) {
    case START:
    case RESTART:
        if ((event & I2C1_SR1_SB) != 0U) {
            I2C1_DR = address | (state == RESTART ? 1U : 0U);
            state = state == RESTART ? READ_ADDRESS : ADDRESS;
        }
        break;
    case ADDRESS:
        if ((event & I2C1_SR1_ADDR) != 0U) {
            (void)I2C1_SR2;
            I2C1_DR = reg;
            state = REGISTER;
        }
        break;
    case REGISTER:
        if ((event & I2C1_SR1_BTF) != 0U) {
            if (count == 0U) {
                I2C1_DR = *bytes;
                state = VALUE;
            } else {
                I2C1_CR1 = I2C1_CR1_PE | I2C1_CR1_START;
                state = RESTART;
            }
        }
        break;
    case VALUE:
        if ((event & I2C1_SR1_BTF) != 0U) {
            return finish(TRANSFER_DONE);
        }
        break;
    case READ_ADDRESS:
        if ((event & I2C1_SR1_ADDR) != 0U) {
            receive();
            (void)I2C1_SR2; /* from here on the clock runs */
            state = DATA;
        }
        break;
    default:
        break;
    }
    return TRANSFER_UNDER_WAY;
}

transfer_t i2c_on_dma(void) {
    DMA1_IFCR = DMA1_IFCR_CGIF7;
    DMA1_CCR7 = 0U;
    return state == DATA ? finish(TRANSFER_DONE) : TRANSFER_UNDER_WAY;
}

transfer_t i2c_on_error(void) {
    const uint32_t error = I2C1_SR1;
    I2C1_SR1 = 0U; /* clears the error flags alone (RM0008 26.6.6) */
    if (state == IDLE) {
        return TRANSFER_UNDER_WAY;
    }
    if ((error & I2C1_SR1_AF) != 0U) {
        return finish(TRANSFER_REFUSED);
    }
    i2c_abort();
    return TRANSFER_FAILED;
}

void i2c_abort(void) {
    reset();
    recover_step = 0U;
}

static void drive(uint32_t pin, bool high) {
    GPIOB_BSRR = 1U << (high ? pin : pin + 16U);
}

bool i2c_recover(void) {
    const uint32_t step = recover_step;
    if (step == 0U) {
        I2C1_CR1 = 0U;
        drive(SCL, true);
        drive(SDA, true);
        pins_set_mode(&GPIOB_CRH, SCL, PIN_OPEN_DRAIN);
        pins_set_mode(&GPIOB_CRH, SDA, PIN_OPEN_DRAIN);
    } else if (step < RECOVER_START) {
        drive(SCL, step % 2U == 0U);
    } else { /* with SCL high */
        drive(SDA, step == RECOVER_STOP);
    }
    recover_step++;
    if (step > 0U && step % 2U == 0U && step < RECOVER_START && (GPIOB_IDR & 1U << SDA) != 0U) {
        recover_step = RECOVER_START;
    }
    if (step < RECOVER_STOP) {
        return false;
    }
    pins_set_mode(&GPIOB_CRH, SCL, PIN_ALTERNATE_DRAIN);
    pins_set_mode(&GPIOB_CRH, SDA, PIN_ALTERNATE_DRAIN);
    i2c_abort();
    return true;
}
