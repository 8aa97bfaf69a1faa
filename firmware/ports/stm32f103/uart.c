/* USART1 at 921600 baud, 8N1, both ways by DMA (RM0008 27.3.13, 13.3, 13.4).
 *
 * Receive: DMA1 channel 5 writes into a ring without end; the reader takes the write position from the
 * channel's counter. An idle line interrupts, so that a burst of bytes costs one interrupt. Transmit: DMA1
 * channel 4 sends one contiguous block of a ring at a time and interrupts at its end. Errors are counted; the
 * CRC of the frames rejects damaged data. */
#include "uart.h"
#include "app/board_links.h"
#include "clock.h"
#include "idle.h"
#include "nvic.h"
#include "stm32f103.h"
#include <string.h>

#define BAUD        921600U
#define RX_BYTES    1024U /* 11 ms at full rate; a power of two */
#define LINE_BYTES  22U   /* a frame; fewer wait for the pause behind them */
#define TX_BYTES    256U  /* 2.8 ms; the main queue is the session's outbox */
#define ERRORS_MAX  255U
#define DIVIDER_MIN 16U /* the receiver takes 16 samples a bit; reached only when no PLL locks */

static uint8_t rx_ring[RX_BYTES];
static volatile uint32_t rx_taken; /* index of the next byte to read */
static uint8_t tx_ring[TX_BYTES];
/* Free-running counts, used modulo TX_BYTES: written by the loop, sent by the interrupt. */
static volatile uint32_t tx_written, tx_sent;
static volatile uint32_t tx_flying; /* bytes of the block that the DMA is sending, 0: none */
static volatile bool tx_refused;    /* the loop waits for room */
static volatile uint32_t errors;

void uart_init(void) {
    RCC_APB2ENR |= RCC_APB2ENR_USART1EN;
    RCC_AHBENR |= RCC_AHBENR_DMA1EN;
    DMA1_CPAR5 = (uint32_t)(uintptr_t)&USART1_DR;
    DMA1_CMAR5 = (uint32_t)(uintptr_t)rx_ring;
    DMA1_CNDTR5 = RX_BYTES;
    DMA1_CCR5 =
        DMA1_CCR1_EN | DMA1_CCR1_CIRC | DMA1_CCR1_MINC | DMA1_CCR1_HTIE | DMA1_CCR1_TCIE | DMA1_CCR1_PL_HIGH;
    DMA1_CPAR4 = (uint32_t)(uintptr_t)&USART1_DR;
    nvic_enable(IRQ_DMA1_Channel4);
    nvic_enable(IRQ_DMA1_Channel5);
    nvic_enable(IRQ_USART1);
    /* Divider in 1/16 of 16 samples, that is, clock cycles per bit, rounded: 78 at 72 MHz is 0.16 % fast. */
    const uint32_t divider = (clock_mhz() * 1000000U + BAUD / 2U) / BAUD;
    USART1_BRR = divider < DIVIDER_MIN ? DIVIDER_MIN : divider;
    USART1_CR3 = USART1_CR3_DMAR | USART1_CR3_DMAT | USART1_CR3_EIE;
    USART1_CR1 = USART1_CR1_UE | USART1_CR1_TE | USART1_CR1_RE | USART1_CR1_IDLEIE;
}

uint32_t uart_errors(void) {
    return errors;
}

static void count_error(void) {
    if (errors < ERRORS_MAX) {
        errors++;
    }
}

void uart_handler(void) {
    /* Reading SR and then DR clears IDLE and every error (RM0008 27.6.1). It takes no byte from the DMA: the
     * line has been idle for a character, or DR holds the damaged byte. */
    const uint32_t status = USART1_SR;
    (void)USART1_DR;
    if ((status & (USART1_SR_FE | USART1_SR_NE | USART1_SR_ORE)) != 0U) {
        count_error();
    }
    idle_tell();
    idle_end();
}

void uart_rx_dma_handler(void) {
    const uint32_t status = DMA1_ISR;
    DMA1_IFCR = DMA1_IFCR_CGIF5;
    /* The DMA begins to fill a half of the ring that still holds unread bytes: those are lost. */
    const uint32_t half = RX_BYTES / 2U;
    const uint32_t taken = rx_taken;
    if (((status & DMA1_ISR_HTIF5) != 0U && taken > half) ||
        ((status & DMA1_ISR_TCIF5) != 0U && taken > 0U && taken < half)) {
        count_error();
    }
    idle_end();
}

/* Where the DMA writes the next byte. */
static uint32_t rx_end(void) {
    return (RX_BYTES - DMA1_CNDTR5) % RX_BYTES;
}

bool uart_line_waits(void) {
    return (rx_end() - rx_taken) % RX_BYTES >= LINE_BYTES;
}

size_t board_uart_read(uint8_t *bytes, size_t room) {
    const uint32_t end = rx_end();
    memory_fence(); /* the bytes are read after the counter */
    uint32_t from = rx_taken;
    const size_t waiting = (end - from) % RX_BYTES;
    const size_t count = waiting < room ? waiting : room;
    const size_t to_end = RX_BYTES - from;
    const size_t first = count < to_end ? count : to_end;
    memcpy(bytes, &rx_ring[from], first);
    if (count > first) {
        memcpy(bytes + first, rx_ring, count - first);
    }
    from = (from + count) % RX_BYTES;
    memory_fence();
    rx_taken = from;
    if (count > 0U && from != end) {
        idle_tell(); /* the loop fetches the rest in its next turn */
        idle_end();
    }
    return count;
}

/* Starts the next block. Call only while none is being sent: the channel's count and address may be written
 * only while it is off (RM0008 13.3.3). */
static void send_next(void) {
    const uint32_t from = tx_sent % TX_BYTES;
    const uint32_t waiting = tx_written - tx_sent;
    const uint32_t to_end = TX_BYTES - from;
    const uint32_t count = waiting < to_end ? waiting : to_end;
    tx_flying = count;
    if (count > 0U) {
        DMA1_CNDTR4 = count;
        DMA1_CMAR4 = (uint32_t)(uintptr_t)&tx_ring[from];
        DMA1_CCR4 = DMA1_CCR1_EN | DMA1_CCR1_DIR | DMA1_CCR1_MINC | DMA1_CCR1_TCIE | DMA1_CCR1_TEIE;
    }
}

void uart_tx_dma_handler(void) {
    if ((DMA1_ISR & DMA1_ISR_TEIF4) != 0U) {
        count_error(); /* the block is lost, the next one is sent */
    }
    DMA1_IFCR = DMA1_IFCR_CGIF4;
    DMA1_CCR4 = 0U;
    tx_sent += tx_flying;
    send_next();
    if (tx_refused) {
        tx_refused = false;
        idle_end();
    }
}

size_t board_uart_room(void) {
    tx_refused = true; /* set before the check, because a block may end in between */
    const size_t room = TX_BYTES - (tx_written - tx_sent);
    tx_refused = room == 0U;
    return room;
}

size_t board_uart_write(const uint8_t *bytes, size_t count) {
    const size_t room = TX_BYTES - (tx_written - tx_sent);
    const size_t accepted = count < room ? count : room;
    const size_t to = tx_written % TX_BYTES, to_end = TX_BYTES - to;
    const size_t first = accepted < to_end ? accepted : to_end;
    memcpy(&tx_ring[to], bytes, first);
    if (accepted > first) {
        memcpy(tx_ring, bytes + first, accepted - first);
    }
    memory_fence();
    tx_written += (uint32_t)accepted;
    /* While a block is being sent, its interrupt sends the new bytes next; while none is, no interrupt can
     * come in between. */
    if (tx_flying == 0U) {
        send_next();
    }
    return accepted;
}
