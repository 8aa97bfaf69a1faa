/* USART3 at 420 kBd, 8N1, receiving only, one interrupt of 20 instructions a byte (RM0008 27.3.3, 27.6):
 * every DMA channel that could serve it is taken. Nothing is sent to the receiver. Errors are counted; the
 * CRC of the frames rejects damaged data. The loop makes a whole turn every few milliseconds by itself, so no
 * byte wakes it. */
#include "app/board_receiver.h"
#include "clock.h"
#include "nvic.h"
#include "receiver_lines.h"
#include "stm32f103.h"

#define BAUD       420000U
#define RX_BYTES   256U /* 6 ms at full rate; a power of two */
#define ERRORS_MAX 255U

static uint8_t sticks_ring[RX_BYTES];
/* Free-running counts, used modulo RX_BYTES: written by the interrupt, read by the loop. */
static volatile uint32_t sticks_written, sticks_taken;
static volatile uint32_t sticks_errors;

void receiver_uart_init(void) {
    RCC_APB1ENR |= RCC_APB1ENR_USART3EN;
    nvic_enable(IRQ_USART3);
    /* Clock cycles per bit, rounded: 86 at 36 MHz is 0.3 % slow; 76 at 32 MHz and 19 at 8 MHz, from the
     * internal oscillator, are 0.3 % fast, to which that adds its own error of up to 2.5 %. */
    USART3_BRR = (clock_pclk1_mhz() * 1000000U + BAUD / 2U) / BAUD;
    USART3_CR1 = USART3_CR1_UE | USART3_CR1_RE | USART3_CR1_RXNEIE;
}

uint32_t receiver_uart_errors(uint32_t others) {
    const uint32_t errors = others + sticks_errors;
    return errors < ERRORS_MAX ? errors : ERRORS_MAX;
}

void receiver_uart_handler(void) {
    /* Reading SR and then DR clears every error, and the request. An overrun lost a later byte than that in
     * DR, if there is still one. */
    const uint32_t status = USART3_SR;
    const uint8_t byte = (uint8_t)USART3_DR;
    const uint32_t to = sticks_written;
    const bool full = to - sticks_taken == RX_BYTES;
    if (((status & (USART3_SR_FE | USART3_SR_NE | USART3_SR_ORE)) != 0U || full) &&
        sticks_errors < ERRORS_MAX) {
        sticks_errors++;
    }
    if ((status & USART3_SR_RXNE) != 0U && !full) {
        sticks_ring[to % RX_BYTES] = byte;
        memory_fence();
        sticks_written = to + 1U;
    }
}

size_t board_receiver_read(uint8_t *bytes, size_t room) {
    const uint32_t end = sticks_written;
    memory_fence(); /* the bytes are read after the count */
    uint32_t at = sticks_taken;
    size_t count = 0U;
    while (count < room && at != end) {
        bytes[count++] = sticks_ring[at++ % RX_BYTES];
    }
    memory_fence();
    sticks_taken = at;
    return count;
}
