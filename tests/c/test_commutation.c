/* Six steps: against the back-EMF of an ideal motor, which knows no table; and every limit. */
#include "check.h"
#include "core/commutation.h"
#include <math.h>

#define PERIOD 1800U
#define ON_MAX 1700U

/* The motor in twelfths of an electrical turn: back-EMF is flat from 1/12 to 5/12, zero at 0 and at 1/2, and
 * mirrored. Phase B and C come 4 and 8 twelfths later. */
static double back_emf(int phase, double twelfths) {
    const double at = fmod(twelfths - 4.0 * phase + 24.0, 12.0);
    if (at < 1.0) {
        return at;
    }
    if (at <= 5.0) {
        return 1.0;
    }
    if (at < 7.0) {
        return 6.0 - at;
    }
    return at <= 11.0 ? -1.0 : at - 12.0;
}

/* A Hall sensor is high for half a turn, beginning where its phase's back-EMF becomes positive and flat less
 * a sixth of a turn; with the forward sequence of the header, state 5 is the first sixth of phase A's flat
 * top. */
static uint32_t hall_at(double twelfths) {
    uint32_t state = 0;
    for (int phase = 0; phase < 3; phase++) {
        const double at = fmod(twelfths - 1.0 - 4.0 * phase + 24.0, 12.0);
        state |= at < 6.0 ? 1U << phase : 0U;
    }
    return state;
}

/* Voltage against back-EMF over the two phases that carry current: the torque's sign and size. */
static double torque(const commutation_t *c, double twelfths) {
    double sum = 0.0;
    for (int phase = 0; phase < 3; phase++) {
        const double sign = c->drive[phase] == COMMUTATION_PWM   ? 1.0
                            : c->drive[phase] == COMMUTATION_LOW ? -1.0
                                                                 : 0.0;
        sum += sign * back_emf(phase, twelfths);
    }
    return sum;
}

/* In every place, at full torque: both phases that carry current are on their flat tops. */
static void torque_has_the_sign_of_the_duty(void) {
    for (int step = 0; step < 1200; step++) {
        const double twelfths = (step + 0.5) / 100.0;
        commutation_t forward, backward;
        CHECK(commutation_step(&forward, hall_at(twelfths), 20000, PERIOD, ON_MAX));
        CHECK(commutation_step(&backward, hall_at(twelfths), -20000, PERIOD, ON_MAX));
        CHECK(torque(&forward, twelfths) == 2.0);
        CHECK(torque(&backward, twelfths) == -2.0);
        CHECK(forward.on == backward.on);
    }
}

static void one_switches_one_sinks_one_floats(void) {
    for (uint32_t hall = 1; hall < 7; hall++) {
        for (int32_t duty = -32767; duty <= 32767; duty += 4681) {
            commutation_t c;
            unsigned seen = 0;
            CHECK(commutation_step(&c, hall, duty, PERIOD, ON_MAX));
            for (int phase = 0; phase < 3; phase++) {
                seen |= 1U << c.drive[phase];
            }
            CHECK(seen == 7U);
        }
    }
}

static void a_state_that_cannot_be_floats_everything(void) {
    for (uint32_t hall = 0; hall <= 7; hall += 7) {
        commutation_t c;
        CHECK(!commutation_step(&c, hall, 20000, PERIOD, ON_MAX));
        CHECK(c.drive[0] == COMMUTATION_FLOAT && c.drive[1] == COMMUTATION_FLOAT &&
              c.drive[2] == COMMUTATION_FLOAT && c.on == 0);
    }
}

static void duty_to_counts(void) {
    static const struct {
        int32_t duty;
        uint32_t on;
    } rows[] = {{0, 0},           {16384, 900},    {-16384, 900},       {18, 0},
                {19, 1},          {30947, 1699},   {30965, ON_MAX},     {32767, ON_MAX},
                {-32767, ON_MAX}, {40000, ON_MAX}, {INT32_MAX, ON_MAX}, {INT32_MIN, ON_MAX}};
    for (unsigned i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        commutation_t c;
        CHECK(commutation_step(&c, 3, rows[i].duty, PERIOD, ON_MAX));
        CHECK(c.on == rows[i].on);
    }
    commutation_t c; /* the widest of everything */
    CHECK(commutation_step(&c, 3, 32767, 65535, 65535) && c.on == 65533);
}

static void edges_are_counted_with_their_sign(void) {
    static const uint32_t forward[6] = {5, 1, 3, 2, 6, 4};
    for (int i = 0; i < 6; i++) {
        const uint32_t from = forward[i];
        CHECK(hall_at(2 * i + 1.5) == from);
        CHECK(commutation_moved(from, from) == 0);
        CHECK(commutation_moved(from, forward[(i + 1) % 6]) == 1);
        CHECK(commutation_moved(from, forward[(i + 5) % 6]) == -1);
        for (int far = 2; far < 5; far++) {
            CHECK(commutation_moved(from, forward[(i + far) % 6]) == 0);
        }
        CHECK(commutation_moved(from, 0) == 0 && commutation_moved(7, from) == 0);
    }
}

int main(void) {
    torque_has_the_sign_of_the_duty();
    one_switches_one_sinks_one_floats();
    a_state_that_cannot_be_floats_everything();
    duty_to_counts();
    edges_are_counted_with_their_sign();
    return check_failures != 0;
}
