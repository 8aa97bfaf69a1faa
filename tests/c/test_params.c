/* Which words may change during a run, and how far while the board is armed. */
#include "check.h"
#include "generated/params.h"
#include <stddef.h>

#define ROW(field) ((uint16_t)(offsetof(params_t, field) / 4U))
#define KP         ROW(control.pid.kp_q22)
#define SLEW       ROW(control.pid.slew_q22)

static uint16_t refused(uint16_t index, int32_t from, int32_t to, bool near) {
    params_t a, b;
    params_default(&a);
    params_set_word(&a, index, (uint32_t)from);
    b = a;
    params_set_word(&b, index, (uint32_t)to);
    const params_live_t gains = params_live(&a);
    return params_fixed_change(&a, &b, near ? &gains : NULL);
}

static void within_a_factor_of_two(void) {
    static const struct {
        int32_t from, to;
        bool taken;
    } rows[] = {
        {100, 200, true},
        {100, 201, false},
        {100, 50, true},
        {100, 49, false},
        {101, 51, true},
        {101, 50, false},
        {1, 2, true},
        {1, 0, false},
        {0, 0, true},
        {0, 1, false},
        {1 << 30, 1 << 29, true},
        {1 << 29, 1 << 30, true},
        {(1 << 29) - 1, 1 << 30, false},
        {INT32_MAX, 1 << 30, true},
        {INT32_MAX, (1 << 30) - 1, false},
        {1 << 30, INT32_MAX, true},
    };
    for (unsigned i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        const uint16_t wanted = rows[i].taken ? PARAMS_COUNT : KP;
        CHECK(refused(KP, rows[i].from, rows[i].to, true) == wanted);
        CHECK(refused(KP, -rows[i].from, -rows[i].to, true) == wanted);
        CHECK(rows[i].from == 0 || refused(KP, rows[i].from, -rows[i].to - 1, true) == KP);
        CHECK(refused(KP, rows[i].from, rows[i].to, false) == PARAMS_COUNT);
    }
    CHECK(refused(KP, INT32_MIN, INT32_MAX, true) == KP);
    CHECK(refused(KP, INT32_MIN, -1, true) == KP);
}

/* Of the whole table exactly the gains may change, and the first other word is named. */
static void gains_alone(void) {
    unsigned live = 0;
    params_t from, to;
    params_default(&from);
    for (uint16_t i = 0; i < PARAMS_COUNT; i++) {
        const uint16_t found = refused(i, 1000, 1001, i % 2U == 0U);
        CHECK(found == i || found == PARAMS_COUNT);
        live += found == PARAMS_COUNT;
    }
    CHECK(live == 6U);
    to = from;
    const params_live_t gains = params_live(&from);
    CHECK(params_fixed_change(&from, &to, &gains) == PARAMS_COUNT);
    to.imu_axis ^= 1U;
    to.control.pid.slew_q22 ^= 1;
    to.control.pid.kp_q22 ^= 1;
    CHECK(params_fixed_change(&from, &to, &gains) == SLEW);
    to.control.pid.kp_q22 *= 3;
    CHECK(params_fixed_change(&from, &to, &gains) == KP);
    CHECK(params_fixed_change(&from, &to, NULL) == SLEW);
}

/* Steps of a factor of two do not add up: what counts is the gain at arming. */
static void not_step_by_step(void) {
    params_t from, to;
    params_default(&from);
    to = from;
    const params_live_t gains = params_live(&from);
    to.control.pid.kp_q22 = 2 * from.control.pid.kp_q22;
    CHECK(params_fixed_change(&from, &to, &gains) == PARAMS_COUNT);
    from = to;
    to.control.pid.kp_q22++;
    CHECK(params_fixed_change(&from, &to, &gains) == KP);
    to.control.pid.kp_q22 = gains.word[0] / 2; /* a quarter of what is in use */
    CHECK(params_fixed_change(&from, &to, &gains) == PARAMS_COUNT || gains.word[0] % 2 != 0);
}

int main(void) {
    within_a_factor_of_two();
    gains_alone();
    not_step_by_step();
    return check_failures != 0;
}
