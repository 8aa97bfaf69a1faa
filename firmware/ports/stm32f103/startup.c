/* From reset to the loop: interrupts and their vector table, initial memory. */
#include "adc.h"
#include "app/board.h"
#include "app/board_actuators.h"
#include "app/loop.h"
#include "bootloader.h"
#include "bridge.h"
#include "bxcan.h"
#include "faults.h"
#include "guard.h"
#include "imu.h"
#include "linker.h"
#include "pwm.h"
#include "receiver_lines.h"
#include "sampling.h"
#include "stall.h"
#include "stm32f103.h"
#include "systick.h"
#include "uart.h"

void reset_handler(void);

/* ---- interrupts that concern more than one peripheral ---- */

/* Every millisecond. Only SysTick interrupts the other handlers: it counts the time, monitors loop and stack,
 * and writes nothing that another handler writes, except neutral outputs. All other periodic work runs in
 * PendSV, at the priority of the other handlers. */
static void systick_handler(void) {
    systick_count();
    const bool astray = pwm_astray();
    if (astray) {
        guard_outputs_upset();
    }
    if (stall_tick() || astray) {
        board_actuator_neutral();
    }
    faults_check_stack();
    SCB_ICSR = SCB_ICSR_PENDSVSET;
}

static void pendsv_handler(void) {
    imu_poll_ms();
}

/* A scan is stored. The interrupt of its trigger may still be pending: it is handled first. */
static void adc_dma_handler(void) {
    sampling_timer_handler();
    adc_on_scan();
}

/* ---- vector table ---- */

typedef void (*vector_t)(void);
#define F fault_entry

// clang-format off
/* RM0008 10.1.2, table 63, with the high-density parts' 60 interrupts. NMI, a failed crystal, is a fault. */
__attribute__((section(".vectors"), used)) static const vector_t vectors[16 + 60] = {
    (vector_t)(uintptr_t)stack_top, reset_handler, F, F, F, F, F, F, F, F, F, F, F, F, pendsv_handler, systick_handler,
    /*  0 */ F, F, F, F, F, F, F, F, F, F,
    /* 10 */ F, adc_dma_handler, spi_dma_handler, F, uart_tx_dma_handler, uart_rx_dma_handler, F, i2c_dma_handler, F, can_tx_handler,
    /* 20 */ can_rx_handler, F, F, F, F, F, F, ppm_capture_handler, bridge_handler, sampling_timer_handler,
    /* 30 */ F, i2c_event_handler, i2c_error_handler, F, F, F, F, uart_handler, F, receiver_uart_handler,
    /* 40 */ F, F, F, F, F, F, F, F, F, F,
    /* 50 */ F, F, F, F, F, F, F, F, F, F,
};
// clang-format on

/* ---- reset ---- */

void reset_handler(void) {
    bootloader_if_asked();
    /* A ROM bootloader that jumped here left its own table in force. */
    SCB_VTOR = (uint32_t)(uintptr_t)image_start;
    for (uint32_t *to = data_start, *from = data_load; to < data_end; to++, from++) {
        *to = *from;
    }
    for (uint32_t *to = bss_start; to < bss_end; to += 4) { /* stm32f103.ld aligns the end to 16 bytes */
        to[0] = to[1] = to[2] = to[3] = 0U;
    }
    loop_start();
    for (;;) {
        loop_turn();
        board_idle(); /* nothing on the stack is used again after it */
    }
}
