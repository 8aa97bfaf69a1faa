#include "commutation.h"

#define DUTY_MAX 32767

/* Place of a Hall state in the forward order, 1 to 6; 0 for an invalid state. */
static const uint8_t place[8] = {0, 2, 4, 3, 6, 1, 5, 0};

/* The phase that drives and the one that sinks at each place, for forward torque: the pair whose back-EMF is
 * at its flat top. Backward torque swaps the two. */
static const uint8_t driving[7] = {0, 0, 0, 1, 1, 2, 2};
static const uint8_t sinking[7] = {0, 1, 2, 2, 0, 0, 1};

bool commutation_step(commutation_t *c, uint32_t hall, int32_t duty_q15, uint32_t period, uint32_t on_max) {
    const uint32_t at = place[hall & 7U];
    const bool forward = duty_q15 >= 0;
    const uint32_t asked = forward ? (uint32_t)duty_q15 : 0U - (uint32_t)duty_q15;
    const uint32_t on = (asked > DUTY_MAX ? DUTY_MAX : asked) * period >> 15;

    *c = (commutation_t){.on = on < on_max ? on : on_max};
    if (at == 0U) {
        c->on = 0U;
        return false;
    }
    c->drive[forward ? driving[at] : sinking[at]] = COMMUTATION_PWM;
    c->drive[forward ? sinking[at] : driving[at]] = COMMUTATION_LOW;
    return true;
}

int32_t commutation_moved(uint32_t from, uint32_t to) {
    const uint32_t before = place[from & 7U], after = place[to & 7U];

    if (before == 0U || after == 0U) {
        return 0;
    }
    const uint32_t steps = (after + 6U - before) % 6U;
    return steps == 1U ? 1 : steps == 5U ? -1 : 0;
}
