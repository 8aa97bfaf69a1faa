/* A board of memory alone: the session and the core as the main loop runs them, one turn per call. Python
 * loads it as a shared library and is its UART, its clock, its timer and its sensors. */
#include "flash.h"
#include "link/requests.h"
#include <string.h>

typedef struct {
    board_identity_t identity;
    control_t control;
    params_t params;
    session_t session;
    session_buffers_t buffers;
    int16_t sensors[CONTROL_RAW_MAX];
    uint32_t faults;
    board_health_t health;
    bool switch_closed;       /* the arm switch */
    uint32_t tick_us;         /* time of the last tick */
    uint32_t pulse_halfus[2]; /* what the actuator gets: neutral while disarmed */
    uint32_t steps;
} link_board_t;

size_t link_board_bytes(void);
void link_board_init(link_board_t *b, uint32_t seed);
void link_board_sensors(link_board_t *b, const int16_t raw[CONTROL_RAW_MAX], uint32_t faults);
void link_board_health(link_board_t *b, const board_health_t *health);
void link_board_switch(link_board_t *b, bool closed);
size_t link_board_take(link_board_t *b, const uint8_t *bytes, size_t count, uint32_t now_us);
void link_board_turn(link_board_t *b, uint32_t now_us);
size_t link_board_give(link_board_t *b, uint8_t *out, size_t room);
size_t link_board_room(const link_board_t *b);
bool link_board_leaves(const link_board_t *b, uint32_t now_us); /* for the ROM bootloader */
bool link_board_armed(const link_board_t *b);
uint32_t link_board_steps(const link_board_t *b);
void link_board_pulses(const link_board_t *b, uint32_t pulse_halfus[2]);
size_t link_board_parse(const uint8_t *bytes, size_t count, uint8_t *frames, uint32_t *bad);
uint8_t link_board_crc8(uint16_t id, uint8_t dlc, const uint8_t data[8]);

/* Memory is not checked here. */
void board_parameters_seal(void) {}

size_t link_board_bytes(void) {
    return sizeof(link_board_t);
}

void link_board_init(link_board_t *b, uint32_t seed) {
    memset(b, 0, sizeof *b);
    b->identity = (board_identity_t){.part_id = 0x410,
                                     .unique_id = {seed, 0x22222222U, 0x33333333U},
                                     .git_hash = {0x01234567U, 0x89ABCDEFU},
                                     .flash_kib = 64,
                                     .ram_kib = 20,
                                     .reset_cause = 0x0CU};
    const store_report_t saved = store_load(&b->params);
    session_init(&b->session, &b->buffers, &b->identity, &b->control, &b->params);
    session_parameters_loaded(&b->session, &saved);
}

void link_board_sensors(link_board_t *b, const int16_t raw[CONTROL_RAW_MAX], uint32_t faults) {
    memcpy(b->sensors, raw, sizeof b->sensors);
    b->faults = faults;
}

void link_board_health(link_board_t *b, const board_health_t *health) {
    b->health = *health;
}

void link_board_switch(link_board_t *b, bool closed) {
    b->switch_closed = closed;
}

/* Bytes of the UART, as many as can be answered; returns how many were taken. */
size_t link_board_take(link_board_t *b, const uint8_t *bytes, size_t count, uint32_t now_us) {
    const size_t room = requests_room(&b->session);

    count = count < room ? count : room;
    requests_receive(&b->session, bytes, count, now_us);
    return count;
}

static bool take_tick(link_board_t *b, uint32_t now_us) {
    if (now_us - b->tick_us < session_period_us(&b->session)) {
        return false;
    }
    b->tick_us += session_period_us(&b->session);
    return true;
}

static bool take_sample(link_board_t *b, uint32_t now_us, int16_t raw[CONTROL_RAW_MAX], int32_t *setpoint) {
    if (session_mode(&b->session) == RUN_IDLE) {
        return false;
    }
    if (session_mode(&b->session) == RUN_REALTIME && !take_tick(b, now_us)) {
        return false;
    }
    if (!session_live(&b->session)) {
        return session_next_sample(&b->session, raw, setpoint);
    }
    memcpy(raw, b->sensors, sizeof b->sensors);
    *setpoint = session_setpoint(&b->session);
    return true;
}

/* One turn of the loop behind the receiving. */
void link_board_turn(link_board_t *b, uint32_t now_us) {
    int16_t raw[CONTROL_RAW_MAX];
    int32_t setpoint;

    static const board_can_health_t quiet = {.bus_off = true};

    session_report_can(&b->session, &quiet);
    session_report_faults(&b->session, b->faults);
    session_report_sensors(&b->session, &b->health);
    session_report_switch(&b->session, b->switch_closed, now_us);
    session_poll(&b->session, now_us);
    if (session_pop_begin(&b->session)) {
        b->tick_us = now_us;
    }
    if (take_sample(b, now_us, raw, &setpoint)) {
        control_step(&b->control, &b->params.control, raw, setpoint);
        b->steps++;
        if (session_driving(&b->session)) {
            memcpy(b->pulse_halfus, b->control.quad.words.pulse_halfus, sizeof b->pulse_halfus);
        }
        session_stepped(&b->session);
    }
    if (!session_driving(&b->session)) {
        b->pulse_halfus[0] = b->pulse_halfus[1] = (uint32_t)b->params.control.esc.neutral_halfus;
    }
}

size_t link_board_give(link_board_t *b, uint8_t *out, size_t room) {
    return session_transmit(&b->session, out, room);
}

size_t link_board_room(const link_board_t *b) {
    return requests_room(&b->session);
}

bool link_board_leaves(const link_board_t *b, uint32_t now_us) {
    return session_bootloader_due(&b->session, now_us);
}

bool link_board_armed(const link_board_t *b) {
    return session_armed(&b->session);
}

uint32_t link_board_steps(const link_board_t *b) {
    return b->steps;
}

void link_board_pulses(const link_board_t *b, uint32_t pulse_halfus[2]) {
    memcpy(pulse_halfus, b->pulse_halfus, sizeof b->pulse_halfus);
}

/* All frames with a right CRC out of a stream, ten bytes each (id big-endian, data); *bad: lines thrown away.
 */
size_t link_board_parse(const uint8_t *bytes, size_t count, uint8_t *frames, uint32_t *bad) {
    slcan_rx_t rx;
    size_t found = 0;

    slcan_rx_init(&rx);
    for (size_t i = 0; i < count; i++) {
        can_frame_t frame;

        if (slcan_rx_push_byte(&rx, bytes[i], &frame) == SLCAN_FRAME && e2e_check(&frame)) {
            frames[10 * found] = (uint8_t)(frame.id >> 8);
            frames[10 * found + 1] = (uint8_t)(frame.id & 0xFFU);
            memcpy(&frames[10 * found + 2], frame.data, 8);
            found++;
        }
    }
    *bad = rx.bad;
    return found;
}

uint8_t link_board_crc8(uint16_t id, uint8_t dlc, const uint8_t data[8]) {
    can_frame_t frame = {.id = id, .dlc = dlc};

    memcpy(frame.data, data, sizeof frame.data);
    return e2e_crc8(&frame);
}
