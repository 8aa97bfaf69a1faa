/* The shipped main loop on the native port, over UART and over CAN, with every system: it runs, reports what
 * happens at once, and keeps its parameters. Under the sanitizers, this is the test that no input makes the
 * loop touch what is not its own. */
#include "app/board_links.h"
#include "core/digest.h"
#include "loop_host.h"
#include "ports/native/flash.h"

#define SAMPLES 40U

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
            nothing_upsets_the_loop(system);
            a_cut_while_saving_loses_neither_set(system);
        }
    }
    return check_failures != 0;
}
