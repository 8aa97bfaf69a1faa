/* Watch over the main loop while the actuators may move: SysTick, which interrupts every other handler,
 * counts the ticks since the loop last came round. After 20 ticks the outputs become neutral and stay so
 * until the next run begins. A neutral pulse begins at most 2.2 ms later (pwm.c), of the 50 ms limit. A hang
 * with masked interrupts stops SysTick, too: the window watchdog resets the board.
 */
#include "stall.h"
#include "app/board.h"
#include "idle.h"

#define STALL_TICKS 20U
/* The two values of a pair differ in many bits. Any other value of `watched` counts as driving, any other
 * value of `state` as stalled. */
#define AT_REST 0x3c5aa5c3U
#define DRIVING 0xc3a55a3cU
#define TURNING 0x5ac33ca5U
#define STALLED 0xa53cc35aU

static volatile uint32_t ticks; /* since the loop last came round */
static volatile uint32_t watched = AT_REST;
static volatile uint32_t state = TURNING;

bool stall_tick(void) {
    if (ticks < STALL_TICKS) {
        ticks++;
    } else if (watched != AT_REST) {
        state = STALLED;
    }
    return state != TURNING;
}

void stall_watch(bool driving) {
    watched = driving ? DRIVING : AT_REST;
}

bool stall_watches(void) {
    return watched != AT_REST;
}

bool stall_latched(void) {
    return state != TURNING;
}

void board_turn(void) {
    idle_turns();
    ticks = 0U;
}

void stall_clear(void) {
    watched = AT_REST;
    ticks = 0U;
    state = TURNING;
}
