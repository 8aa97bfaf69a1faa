/* The main loop: takes each sample from the host or from the sensors, runs control_step on it, drives the
 * actuator and sends the step's signals to the host. Interrupts only move bytes and wake the loop.
 *
 * A whole turn checks the guarded memory, does all this, and seals the memory again. While the board is armed
 * or in lockstep, what wakes the loop is often no work for it: a millisecond has passed, or the UART has room
 * again. Such a turn is short: it passes on what waits to be sent and writes no guarded memory. */
#include "loop.h"
#include "board.h"
#include "board_actuators.h"
#include "board_guard.h"
#include "board_links.h"
#include "board_sensors.h"
#include "generated/messages.h"
#include "generated/outputs.h"
#include "generated/used_parts.h"
#include "link/pilot.h"
#include "link/session.h"
#include "link/stepping.h"
#include "loop_links.h"
#include "systems/control.h"
#include <string.h>

#define SHORT_TURNS USED_ACTUATORS /* a board that is never armed has time for whole ones */
#define DEADLINE_US 10000U         /* from a whole turn to the next; outputs must be safe within 50 ms */
#define FED_FOR_US  4000U          /* after a whole turn, in which short ones feed the watchdog */

BOARD_GUARDED static control_t control;
BOARD_GUARDED static session_t session;
BOARD_GUARDED_PARAMETERS static params_t params;
static session_buffers_t buffers;

/* The outputs are known to be at neutral only while `outputs` has exactly this value: a flipped bit then
 * makes the loop write neutral once more. */
#define OUTPUTS_RESTING 0x3ac9651eU
BOARD_GUARDED static uint32_t outputs;

/* The last whole turn: when it began, how long the next one may wait for a step or for input, whether it fed
 * the watchdog, and the arm switch as it read it. */
BOARD_GUARDED static struct {
    uint32_t us;
#if SHORT_TURNS
    uint32_t within_us;
    bool fed;
    bool switch_closed;
#endif
} turn;

/* True when a step is due, with its inputs: in lockstep when the host has sent a sample, in real time when
 * the timer ticks. */
static bool take_inputs(const session_orders_t *orders, int16_t raw[PLUMB_RAW_MAX], int32_t *setpoint) {
    if (orders->mode == RUN_IDLE || (orders->mode == RUN_REALTIME && !board_take_tick())) {
        return false;
    }
    if (orders->live) {
        memset(raw, 0, PLUMB_RAW_MAX * sizeof raw[0]); /* counts that no sensor of the board gives */
        board_read_sensors(raw);
    }
    return session_take_inputs(&session, raw, setpoint);
}

/* Writes the outputs of the last step to the actuator of the system. */
static void actuate(void) {
    const control_system_t *const system = control_system(&params.control);
    const int32_t *const out = control_words(&control) + system->output_word;

    if (control_drives_pulses(system->output)) {
        board_set_actuator((const uint32_t *)out);
    } else if (control_drives_rotors(system->output)) {
        board_set_rotors((const uint32_t *)out);
    } else if (control_drives_bridge(system->output)) {
        board_set_bridge(out[0]);
    } else if (control_drives_wheels(system->output)) {
        board_set_wheels(out);
    }
}

/* CONTROL_SENSORS_* of the systems and BOARD_SENSORS_* of the boards have the same numbers. */
typedef char control_assert_sensors[(int)CONTROL_SENSORS_NONE == (int)BOARD_SENSORS_NONE &&
                                            (int)CONTROL_SENSORS_ANALOG_3 == (int)BOARD_SENSORS_ANALOG_3 &&
                                            (int)CONTROL_SENSORS_ANALOG_6 == (int)BOARD_SENSORS_ANALOG_6 &&
                                            (int)CONTROL_SENSORS_BALANCE == (int)BOARD_SENSORS_BALANCE &&
                                            (int)CONTROL_SENSORS_SIX_AXES == (int)BOARD_SENSORS_SIX_AXES &&
                                            (int)CONTROL_SENSORS_RIDE == (int)BOARD_SENSORS_RIDE
                                        ? 1
                                        : -1];

/* Chooses the sensors of the system; none while samples come from the host. Neither this function nor the
 * next is inlined, so that their locals do not add to the stack of the rest of the loop. */
__attribute__((noinline)) static void choose_sensors(bool injected) {
    const control_system_t *const system = control_system(&params.control);
    const board_sensors_t wanted = {.kind = injected ? BOARD_SENSORS_NONE : system->sensors,
                                    .oversample_log2 = params.adc_oversample_log2,
                                    .rail_ms = params.rail_ms,
                                    .stuck_ms = params.stuck_ms,
                                    .accel_bus = params.accel_bus,
                                    .accel_rate = params.accel_rate,
                                    .gyro_filter = params.gyro_filter,
                                    .imu_axis = params.imu_axis,
                                    .marks_missing = system->marks_missing};
    board_use_sensors(&wanted);
}

/* Passes the state of the board to the session. */
__attribute__((noinline)) static void report(uint32_t now_us) {
    session_report_t said; /* every member is set; an initialiser would clear the whole first */
    said.faults = board_faults();
    said.switch_closed = board_arm_switch();
#if SHORT_TURNS
    turn.switch_closed = said.switch_closed;
#endif
    said.can = board_can_health();
    board_sensor_health(&said.sensors);
    session_report(&session, &said, now_us);
}

/* True when the last whole turn met the deadline, and an armed board has not missed a period. That disarms
 * the board: an image that is still armed then gets no watchdog feed, and so a reset. */
static bool met_deadline(uint32_t now_us, bool late) {
    const uint32_t turn_us = now_us - turn.us;
    turn.us = now_us;
    return turn_us <= DEADLINE_US && !late;
}

/* Sets pulse frame and neutral pulse from the parameters in use, and the outputs to neutral. */
static void configure_actuator(void) {
    board_configure_actuator(2U * params.esc_period_us, (uint32_t)params.control.esc.neutral_halfus);
    board_actuator_neutral();
}

/* Replaces the parameters in use by the saved ones. */
static store_report_t load_parameters(void) {
    const store_report_t saved = store_load(&params);
    board_parameters_seal();
    return saved;
}

/* Called when guarded memory is damaged: sets up everything in it anew. The run ends, and the board stays
 * disarmed until its next start (BOARD_FAULT_UPSET). */
__attribute__((noinline)) static void recover(void) {
    board_actuator_neutral();
    outputs = OUTPUTS_RESTING;
    const store_report_t saved = load_parameters();
    configure_actuator(); /* the damage may have hit the neutral pulse */
    session_recover(&session, &buffers, board_identity(), &control, &params, &saved);
}

/* In lockstep nothing can be armed and the host compares every step, so the loop saves the time of checking
 * the memory that changes on every turn. The check word of the parameters stays, and is compared when the run
 * ends. */
static void seal_memory(run_mode_t mode) {
    if (mode == RUN_LOCKSTEP) {
        board_memory_release();
    } else {
        board_memory_seal();
    }
}

/* Carries out the orders of the session: timer, actuator and sensors. */
static void obey(const session_orders_t *orders) {
    if (orders->begun) {
        board_set_period_us(0U);
        configure_actuator();
        board_clear_actuator_faults();
        outputs = OUTPUTS_RESTING;
    }
    if (orders->driving && outputs == OUTPUTS_RESTING) {
        board_arm_actuator();
        outputs = 0U;
    }
    choose_sensors(orders->mode != RUN_IDLE && !orders->live);
    board_set_period_us(orders->period_us);
}

/* Runs the steps that are due, at most as many as samples can wait: when ticks come faster than steps run,
 * the loop must still come round to its checks. */
static void run_steps(const session_orders_t *orders) {
    int16_t raw[PLUMB_RAW_MAX];
    int32_t setpoint;
    for (unsigned i = 0U; i < RUN_QUEUE_LENGTH && take_inputs(orders, raw, &setpoint); i++) {
        control_step(&control, &params.control, raw, setpoint);
        if (orders->driving) {
            actuate();
        }
        session_stepped(&session);
    }
    if (outputs != OUTPUTS_RESTING && !orders->driving) {
        board_actuator_neutral();
        outputs = OUTPUTS_RESTING;
    }
}

void loop_start(void) {
    const store_report_t saved = load_parameters();
    board_init(&(board_setup_t){.pins = params.pins, .dead_time_ns = params.dead_time_ns});
    session_init(&session, &buffers, board_identity(), &control, &params, &saved);
    outputs = OUTPUTS_RESTING;
    board_memory_seal();
}

#if SHORT_TURNS
/* True when there is work for a whole turn. What it reads has not been checked: damage can only bring the
 * next whole turn on, or leave it to the next step. */
static bool has_work(uint32_t now_us) {
    return now_us - turn.us >= turn.within_us || board_tick_waits() || board_work_waits() ||
           board_arm_switch() != turn.switch_closed;
}
#endif

static void whole_turn(void) {
    if (!board_memory_intact()) {
        recover();
    }
    board_turn();
    const uint32_t now_us = board_now_us();
    loop_links_receive(&session, now_us);
    session_receive_pilot(&session, now_us);
    report(now_us);
    session_poll(&session, now_us);
    const session_orders_t orders = session_take_orders(&session, now_us);
    const bool fed = met_deadline(now_us, orders.late);
    if (fed) {
        board_feed_watchdog();
    }
    board_can_join(orders.can_kbit, messages_from_host, MESSAGES_FROM_HOST);
    obey(&orders);
    run_steps(&orders);
    loop_links_transmit(&buffers);
    if (orders.bootloader) {
        board_enter_bootloader();
    }
#if SHORT_TURNS
    turn.fed = fed;
    turn.within_us = session_turn_within_us(&session, now_us);
#endif
    seal_memory(orders.mode);
}

const session_t *loop_session(void) {
    return &session;
}

void loop_turn(void) {
#if SHORT_TURNS
    const uint32_t now_us = board_now_us();
    if (!has_work(now_us)) {
        if (turn.fed && now_us - turn.us <= FED_FOR_US) {
            board_feed_watchdog();
        }
        loop_links_transmit(&buffers);
        return;
    }
#endif
    whole_turn();
}
