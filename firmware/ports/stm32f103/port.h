/* What the files of this port share with each other; the application sees board.h alone. */
#ifndef PLUMB_STM32F103_PORT_H
#define PLUMB_STM32F103_PORT_H

#include "app/board.h"
#include "app/board_actuators.h"
#include "app/board_guard.h"
#include "app/board_links.h"
#include "app/board_sensors.h"
#include "app/board_store.h"
#include "stm32f103.h"

/* Something happened that the main loop has to look at. Set by interrupts, cleared when the loop goes to
 * sleep. */
extern volatile bool port_wake;

/* Latched BOARD_FAULT_ bits of this port, written by the main loop and during start-up only. */
extern uint32_t port_faults;

/* clock.c. Frequencies are those of the clock that really runs; timers run at the same rate (RM0008 figure 8:
 * the doubler behind APB1 = HCLK / 2). */
void clock_init(void);
uint32_t clock_mhz(void);
/* Polls until (*address & mask) == value, at most `polls` times, at least 64 cycles apart; false when it gave
 * up. */
bool clock_wait(volatile const uint32_t *address, uint32_t mask, uint32_t value, uint32_t polls);

void pins_clocks(void);
uint32_t strap_read(void); /* BOARD_PINS_; after clock_init() and pins_clocks(), before pins_init() */
/* The pins of a set. actuators: whether those of the speed controllers, or of the bridge, are driven. */
void pins_init(uint32_t pins, bool actuators);
/* control: the CRL or CRH that holds the pin's four mode bits. */
void pins_set_mode(volatile uint32_t *control, uint32_t pin, uint32_t mode);
void time_init(void);
uint32_t time_ms(void);
void uart_init(void);
uint32_t uart_errors(void); /* stops at 255 */
void pwm_init(uint32_t pins);
void pwm_crash(void); /* every output safe, by constants: for code that may not trust memory */
void bridge_init(uint32_t dead_time_ns); /* after time_init(), before its pins: off, all gates driven low */
void bridge_start(void);                 /* once its pins are set up, and had time to settle */
void bridge_arm(void);                   /* switches the bridge on, at duty 0 */
void bridge_off(void);                   /* with any pins, at any time */
uint32_t bridge_faults(void);
void bridge_clear_faults(void);  /* where they are no longer so */
int16_t bridge_hall_count(void); /* edges of the Hall sensors, forward less backward, modulo 2^16 */
void can_init(void);             /* stays off the bus when the clock is not the crystal's */
bool can_overrun(void);
void watchdog_init(void);
void watchdog_feed(void);
void watchdog_feed_longest(void); /* right before the processor stands still for up to 40 ms */

/* stall.c */
void stall_tick(void);          /* from the interrupt of the millisecond */
void stall_watch(bool driving); /* the actuators may move, or are at neutral */
bool stall_latched(void);       /* the loop did not come round: nothing may move until the next run */
void stall_clear(void);

/* sampling.c */
int16_t *sampling_next(void); /* where an interrupt puts the period's raw counts, BOARD_RAW_MAX places */
void sampling_publish(void);  /* ... and says that they are complete */
void sampling_missed(void);   /* from an interrupt: a period has none */
uint32_t sampling_late(void); /* periods missed since the start, stops at 255 */

/* adc.c: analog sensors, started by TIM3. */
void adc_start(const board_sensors_t *use, uint32_t interval_us); /* between two triggers */
void adc_stop(void);
void adc_triggered(bool begins_sample); /* from the interrupt of the trigger */
void adc_poll(void);                    /* tries again when conversions do not come */
bool adc_failed(void);                  /* they do not come, or calibration did not end */
void adc_health(board_health_t *health);

/* i2c.c, spi.c: one access at a time, bounded in time by the caller, who hears of its end in an interrupt. */
typedef enum {
    TRANSFER_DONE,
    TRANSFER_REFUSED, /* nobody answered to the address */
    TRANSFER_FAILED   /* the bus did not behave; it is reset */
} transfer_t;
void i2c_init(void);
/* A register of a slave: reads so many bytes from there on into data, or with 0 writes one from data. */
void i2c_access(uint8_t slave, uint8_t at, uint8_t *data, uint32_t to_read);
void i2c_abort(void);
bool i2c_recover(void); /* half a clock of clearing the bus, to be called every millisecond until true */
void spi_init(void);
void spi_exchange(uint8_t *bytes, uint32_t count);
void spi_abort(void);

/* imu.c: gyro and accelerometer on those buses. */
void imu_use(const board_sensors_t *wanted); /* with interrupts masked */
void imu_period(uint32_t length_us);         /* from the interrupt that begins a period */
void imu_poll_ms(void);                      /* every millisecond, from an interrupt of IRQ_PRIORITY */
void imu_transferred(transfer_t result);     /* an access ended; from its interrupt */
void imu_health(board_health_t *health);

/* crc.c: the chip's CRC unit over whole words, in fours; for the main loop only. */
uint32_t crc_of_words(const uint32_t *from, const uint32_t *end);

/* guard.c */
uint32_t guard_faults(void);
void guard_clock_upset(void); /* time went backwards: the next turn finds memory damaged */

/* faults.c */
void faults_init(board_identity_t *identity); /* takes over what the last crash left behind */
uint32_t entropy_at_start(void);              /* a seed, another one at every start */
void faults_check_stack(void);                /* resets when the stack reached its guard */
void fault_entry(void);                       /* every exception that must not happen */

/* bootloader.c: by the reset handler, before it touches memory */
void bootloader_if_asked(void);

/* startup.c, and the linker script */
extern uint32_t stack_guard[], stack_top[];
void reset_handler(void);

/* Interrupts. All but SysTick have one priority: none interrupts another. SysTick interrupts all of them. */
#define IRQ_PRIORITY 0x80u /* of 0, the highest, to 0xf0 */
void systick_handler(void);
void pendsv_handler(void);
void adc_dma_handler(void);
void uart_tx_dma_handler(void);
void uart_rx_dma_handler(void);
void uart_handler(void);
void bridge_handler(void);
void can_tx_handler(void);
void can_rx_handler(void);
void sampling_timer_handler(void);
void i2c_event_handler(void);
void i2c_error_handler(void);
void i2c_dma_handler(void);
void spi_dma_handler(void);

static inline void irq_enable(uint32_t irq) {
    NVIC_IPR(irq / 4u) |= IRQ_PRIORITY << 8u * (irq % 4u);
    NVIC_ISER(irq / 32u) = 1u << (irq % 32u);
}

/* What is pending of it is no longer meant: its cause has been stopped. */
static inline void irq_forget(uint32_t irq) {
    NVIC_ICPR(irq / 32u) = 1u << (irq % 32u);
}

/* The compiler may not move memory accesses across this; the processor keeps their order anyway. */
static inline void memory_fence(void) {
    __asm volatile("" ::: "memory");
}

#endif
