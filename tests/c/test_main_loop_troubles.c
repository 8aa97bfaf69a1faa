/* The shipped main loop on the native port, over UART and over CAN, with every system that it arms: whatever
 * misbehaves around it leaves the outputs safe. Under the sanitizers, no fault makes the loop touch what is
 * not its own. */
#include "loop_host.h"

#define SAFE_US 50000U /* arming.h: outputs are neutral so long after whatever happened, at the latest */

/* A system that no set of pins drives, or that moves nothing. */
static void never_armed(uint32_t system) {
    system_board(system);
    keeps_alive = true;
    begin(MESSAGE_RUN_BEGIN_RUN_REALTIME_LIVE);
    pass(READY_US);
    CHECK(!execute(MESSAGE_EXECUTE_VERB_ARM));
    pass(SETTLE_US);
    CHECK(native.armed == 0U && safe());
}

static void disarming_is_reported_at_once(uint32_t system) {
    system_board(system);
    drive();
    wait_for_report();
    native.faults = BOARD_FAULT_IMAGE;
    CHECK(reported_after_us(MESSAGE_EVENTS_ID, 6, 3, 90000) <= 3000U);
    CHECK(last(MESSAGE_STATUS_ID) != NULL);
}

static void silence_disarms(void) {
    drive();
    pass(500000);
    CHECK(native.armed == 1U);
    keeps_alive = false;
    pass(SAFE_US);
    CHECK(native.armed == 0U && safe());
}

/* ---- what misbehaves ---- */

static void analog_dies(void) {
    native.adc_dead = 1U;
}
static void input_rails(void) {
    native.railed = 2U;
}
static void input_sticks(void) {
    native.stuck = 1U;
}
static void gyro_is_gone(void) {
    native.gyro = BOARD_SENSOR_NO_ANSWER;
}
static void accel_sticks(void) {
    native.accel = BOARD_SENSOR_STUCK;
}
static void bridge_breaks(void) {
    native.bridge_break = 1U;
}
static void hall_is_lost(void) {
    native.hall_lost = 1U;
}
static void can_dies(void) {
    native.can_dead = 1U;
}
static void can_is_cut(void) {
    native.can_kbit = 0U;
}
static void uart_is_damaged(void) {
    native.uart_damaged = 100000U;
}
static void loop_hangs(void) {
    native.hangs = 1U;
}
static void turns_are_long(void) {
    native.turn_us = 45000U;
}
static void clock_goes_back(void) {
    native_set_clock_us(1000U);
}
static void clock_goes_on(void) {
    native_set_clock_us((uint32_t)native_now_us() + 3600000000U);
}
static void power_is_cut(void) {
    native_power_off();
}
static void host_is_silent(void) {
    keeps_alive = false;
}
static void bit_flips(void) {
    native_flip(check_random() % native_guarded_bytes(), check_random() % 8U);
}
static void fault_is_reported(void) {
    native.faults = BOARD_FAULT_IMAGE;
}

typedef struct {
    const char *name;
    void (*begin)(void);
    bool analog, digital, uart, can; /* what it stops: systems with such sensors, over such a link */
} trouble_t;

static const trouble_t troubles[] = {
    {"analog dies", analog_dies, true, false, true, true},
    {"input rails", input_rails, true, false, true, true},
    {"input sticks", input_sticks, true, false, true, true},
    {"gyro is gone", gyro_is_gone, false, true, true, true},
    {"accel sticks", accel_sticks, false, true, true, true},
    {"bridge breaks", bridge_breaks, false, true, true, true}, /* here the bridge goes with digital sensors */
    {"hall is lost", hall_is_lost, false, true, true, true},
    {"can dies", can_dies, true, true, false, true},
    {"can is cut", can_is_cut, true, true, false, true},
    {"uart is damaged", uart_is_damaged, true, true, true, false},
    {"loop hangs", loop_hangs, true, true, true, true},
    {"turns are long", turns_are_long, true, true, true, true},
    {"clock goes back", clock_goes_back, true, true, true, true},
    {"clock goes on", clock_goes_on, true, true, true, true},
    {"power is cut", power_is_cut, true, true, true, true},
    {"host is silent", host_is_silent, true, true, true, true},
    {"bit flips", bit_flips, true, true, true, true},
    {"fault is reported", fault_is_reported, true, true, true, true},
};

static void trouble_leaves_the_outputs_safe(uint32_t system, const trouble_t *trouble) {
    system_board(system);
    drive();
    trouble->begin();
    pass(SAFE_US + 10000U); /* a frame of telemetry and its answer may be under way */
    const bool digital = declared(system)->sensors >= BOARD_SENSORS_BALANCE;
    const bool stops =
        (digital ? trouble->digital : trouble->analog) && (way == OVER_UART ? trouble->uart : trouble->can);
    if (safe() != stops) {
        printf("%s, system %u, way %u\n", trouble->name, (unsigned)system, (unsigned)way);
    }
    CHECK(safe() == stops);
    pass(300000);
    CHECK(safe() == stops);
}

int main(void) {
    for (way = OVER_UART; way < WAYS; way++) {
        for (uint32_t system = 0; system < 32U; system++) {
            if ((CONTROL_SYSTEMS >> system & 1U) == 0U) {
                continue;
            }
            /* A vehicle that flies is armed on pins of its own; two wheels are driven by none. */
            if (declared(system)->plausibility == NULL || declared(system)->output == CONTROL_OUTPUT_WHEELS) {
                never_armed(system);
                continue;
            }
            system_board(system);
            silence_disarms();
            disarming_is_reported_at_once(system);
            for (size_t i = 0; i < sizeof troubles / sizeof troubles[0]; i++) {
                trouble_leaves_the_outputs_safe(system, &troubles[i]);
            }
        }
    }
    return check_failures != 0;
}
