/* The shipped main loop on the native port, over UART and over CAN, with every system: it runs, it moves what
 * it should, and whatever misbehaves around it leaves the outputs safe. Under the sanitizers, this is the
 * test that no input and no fault makes the loop touch what is not its own. */
#include "app/board_links.h"
#include "core/digest.h"
#include "loop_host.h"
#include "ports/native/flash.h"

#define SAMPLES 40U
#define SAFE_US 50000U /* arming.h: outputs are neutral so long after whatever happened, at the latest */

/* ---- what must hold ---- */

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

static void lockstep_digests_are_the_core_s(uint32_t system) {
    const params_t p = table(system);
    control_t core;
    control_init(&core, &p.control);
    begin(MESSAGE_RUN_BEGIN_RUN_LOCKSTEP);
    received_count = 0;
    for (uint16_t step = 0; step < SAMPLES; step++) {
        const int16_t raw[PLUMB_RAW_MAX] = {(int16_t)(1600 + step), 2048, 3000};
        can_frame_t f = {.id = MESSAGE_SAMPLE_A_ID, .dlc = CAN_FRAME_DLC};
        for (unsigned i = 0; i < 3U; i++) {
            f.data[2U + 2U * i] = (uint8_t)((uint16_t)raw[i] & 0xFFU);
            f.data[3U + 2U * i] = (uint8_t)((uint16_t)raw[i] >> 8);
        }
        e2e_seal(&f, (uint8_t)(step & E2E_COUNTER_MASK), (uint8_t)(step >> 4 & 3U));
        put(&f);
        pass(1000);
        control_step(&core, &p.control, raw, 0);
        const can_frame_t *const newest = last(MESSAGE_STEP_ID);
        CHECK(newest != NULL && half_of(newest) == step);
        CHECK(newest != NULL && word_of(newest) == digest_crc32((const uint8_t *)control_words(&core),
                                                                control_words_bytes(&p.control)));
    }
    CHECK(count_of(MESSAGE_STEP_ID) == SAMPLES);
    (void)ask(MESSAGE_RUN_END_ID, 0, 0, MESSAGE_ACK_ID);
}

static void live_steps_come_with_every_period(void) {
    begin(MESSAGE_RUN_BEGIN_RUN_REALTIME_LIVE);
    pass(100000);
    received_count = 0;
    pass(400000);
    CHECK(count_of(MESSAGE_STEP_ID) >= 99U && count_of(MESSAGE_STEP_ID) <= 101U);
    (void)ask(MESSAGE_RUN_END_ID, 0, 0, MESSAGE_ACK_ID);
}

/* Time in us, at most limit_us, until the board says this about a word of a frame; limit_us: it does not. */
static uint32_t reported_after_us(uint16_t id, unsigned byte, uint8_t bit, uint32_t limit_us) {
    uint32_t us = 0;
    for (received_count = 0; us < limit_us; us += 1000U) {
        const can_frame_t *const f = last(id);
        if (f != NULL && (f->data[byte] >> bit & 1U) != 0U) {
            break;
        }
        pass(1000);
    }
    return us;
}

/* The moment at which the periodic report is longest away. */
static void wait_for_report(void) {
    pass(50000); /* earlier changes have been reported */
    received_count = 0;
    for (unsigned i = 0; i < 200U && last(MESSAGE_STATUS_ID) == NULL; i++) {
        pass(1000);
    }
    CHECK(last(MESSAGE_STATUS_ID) != NULL);
    pass(5000);
}

static void an_event_is_reported_at_once(uint32_t system) {
    const bool digital = declared(system)->sensors >= BOARD_SENSORS_BALANCE;
    system_board(system);
    begin(MESSAGE_RUN_BEGIN_RUN_REALTIME_LIVE);
    pass(200000);
    wait_for_report();
    native.faults = BOARD_FAULT_IMAGE;
    CHECK(reported_after_us(MESSAGE_STATUS_ID, 6, 3, 90000) <= 3000U);
    native.faults = 0;
    wait_for_report();
    (void)ask(MESSAGE_DISARM_ID, 0, 0, MESSAGE_ACK_ID);
    native.gyro = digital ? BOARD_SENSOR_NO_ANSWER : 0U;
    native.railed = digital ? 0U : 1U;
    if (declared(system)->sensors != BOARD_SENSORS_NONE) {
        const uint8_t bit = digital && (BOARD_SENSOR_NO_ANSWER & 1U) == 0U ? 1U : 0U;
        CHECK(reported_after_us(MESSAGE_SENSORS_ID, digital ? 4U : 2U, bit, 90000) <= 3000U);
    }
    native.gyro = native.railed = 0U;
    /* What stays as it is waits for its turn. */
    wait_for_report();
    received_count = 0;
    pass(80000);
    CHECK(count_of(MESSAGE_STATUS_ID) == 0U && count_of(MESSAGE_EVENTS_ID) == 0U);
    CHECK(count_of(MESSAGE_COUNTERS_ID) == 0U && count_of(MESSAGE_SENSORS_ID) == 0U);
    /* A counter that runs is reported at once, and then not more often than every 20 ms. */
    wait_for_report();
    received_count = 0;
    for (unsigned i = 0; i < 80U; i++) {
        can_frame_t f = {.id = MESSAGE_DISARM_ID, .dlc = CAN_FRAME_DLC};
        put(&f); /* without its CRC */
        pass(1000);
        CHECK(i < 3U || count_of(MESSAGE_COUNTERS_ID) >= 1U);
    }
    CHECK(count_of(MESSAGE_COUNTERS_ID) <= 5U);
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

/* Power fails in every operation of a SAVE, in every way: the next start finds the old set or the new one. */
static void a_cut_while_saving_loses_neither_set(uint32_t system) {
    system_board(system);
    params_t p = table(system);
    const uint32_t first = native_flash_operations();
    CHECK(execute(MESSAGE_EXECUTE_VERB_SAVE));
    CHECK(native_flash_operations() == first); /* the same set is not written again */
    p.period_us = 5000;
    for (uint32_t cut = 1; cut < 400U; cut += 13U) {
        const flash_t before = flash;
        (void)ask(MESSAGE_PARAM_SET_ID, ROW(period_us), p.period_us, MESSAGE_PARAM_STAGED_ID);
        (void)ask(MESSAGE_PARAM_COMMIT_ID, PARAMS_COUNT, params_crc32(&p), MESSAGE_ACK_ID);
        native.flash_cut = cut;
        native.flash_cut_way = cut % FLASH_WAYS;
        (void)execute(MESSAGE_EXECUTE_VERB_SAVE);
        const bool failed = native.state == NATIVE_OFF;
        CHECK(failed == (native.flash_cut == 0U));
        native.flash_cut = 0;
        native_power_off();
        native_power_on();
        open_link();
        const uint32_t period_us = ask(MESSAGE_PARAM_GET_ID, ROW(period_us), 0, MESSAGE_PARAM_VALUE_ID);
        CHECK(failed ? period_us == 4000U || period_us == 5000U : period_us == 5000U);
        flash = before;
        native_power_off();
        native_power_on();
        open_link();
    }
}

/* Frames of any kind with any content, and noise, while everything misbehaves now and then. */
static void nothing_upsets_the_loop(uint32_t system) {
    system_board(system);
    for (unsigned i = 0; i < 4000U; i++) {
        const uint32_t pick = check_random();
        can_frame_t f = {.id = messages_from_host[pick % MESSAGES_FROM_HOST], .dlc = CAN_FRAME_DLC};
        for (unsigned k = 2; k < 8U; k++) {
            f.data[k] = (uint8_t)((pick >> 8 & 3U) == 0U ? 0U : check_random() & 0xFFU);
        }
        e2e_seal(&f, (uint8_t)(check_random() & 15U), (uint8_t)(check_random() & 15U));
        put(&f);
        if (pick >> 10 % 16U == 0U) {
            const uint32_t noise = check_random();
            (void)native_uart_send((const uint8_t *)&noise, sizeof noise);
        }
        for (unsigned k = 0; k < BOARD_RAW_MAX; k++) {
            native.raw[k] = (int16_t)check_random_wild();
        }
        native.faults = (check_random() & 63U) == 0U ? check_random() : 0U;
        native.arm_switch = check_random() >> 31;
        pass(check_random() % 3000U);
        if (native.state != NATIVE_RUNNING) {
            native_power_on();
        }
        received_count = 0;
    }
    native.faults = 0;
    native.arm_switch = 0;
    native_power_off();
    native_power_on();
    open_link();
    begin(MESSAGE_RUN_BEGIN_RUN_LOCKSTEP);
}

int main(void) {
    for (way = OVER_UART; way < WAYS; way++) {
        for (uint32_t system = 0; system < 32U; system++) {
            if ((CONTROL_SYSTEMS >> system & 1U) == 0U) {
                continue;
            }
            const params_t p = table(system);
            CHECK(control_params_valid(&p.control));
            system_board(system);
            lockstep_digests_are_the_core_s(system);
            live_steps_come_with_every_period();
            an_event_is_reported_at_once(system);
            /* A vehicle that flies is armed on pins of its own; two wheels are driven by none. */
            if (declared(system)->plausibility == NULL || declared(system)->output == CONTROL_OUTPUT_WHEELS) {
                never_armed(system);
            } else {
                silence_disarms();
                disarming_is_reported_at_once(system);
                for (size_t i = 0; i < sizeof troubles / sizeof troubles[0]; i++) {
                    trouble_leaves_the_outputs_safe(system, &troubles[i]);
                }
            }
            nothing_upsets_the_loop(system);
            a_cut_while_saving_loses_neither_set(system);
        }
    }
    return check_failures != 0;
}
