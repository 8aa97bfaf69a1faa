/* The port's own bridge driver, moved by the test: results[0] is a command, done when it reads 0 again. */
#include "../../firmware/ports/stm32f103/bridge.c"
#include "../../firmware/core/commutation.c"
#include "../../firmware/ports/stm32f103/clock.c"
#include "../../firmware/ports/stm32f103/pins.c"
#include "../../firmware/ports/stm32f103/systick.c"

__attribute__((section(".results"), used)) volatile uint32_t results[64];
enum { IDLE, ARM, DUTY, OFF, CLEAR, RAPID };

volatile bool idle_over;
bool stall_latched(void) {
    return false;
}
void guard_clock_upset(void) {}

void systick_handler(void);
void systick_handler(void) {
    systick_count();
}

void tim2_handler(void);
void tim2_handler(void) {
    bridge_handler();
}

int main(void) {
    const uint32_t dead_time_ns = results[1]; /* put there before the start */
    results[0] = IDLE;
    (void)clock_init(true);
    systick_init();
    pins_clocks();
    bridge_init(dead_time_ns);
    pins_init(BOARD_PINS_BRIDGE, true);
    bridge_start();
    for (;;) {
        const uint32_t command = results[0];
        if (command == ARM) {
            bridge_arm();
        } else if (command == DUTY) {
            board_set_bridge((int32_t)results[2]);
        } else if (command == RAPID) { /* as fast as it goes */
            for (uint32_t i = 0; i < 20U; i++) {
                board_set_bridge((int32_t)results[2]);
            }
        } else if (command == OFF) {
            bridge_off();
        } else if (command == CLEAR) {
            bridge_clear_faults();
        }
        if (command != IDLE) {
            results[0] = IDLE;
        }
        results[3] = (uint32_t)(int32_t)bridge_hall_count();
        results[4] = bridge_faults();
        results[5]++;
    }
}
