/* What a run has learned goes into a parameter only within its range. */
#include "app/board_guard.h"
#include "check.h"
#include "link/staging.h"

static unsigned seals;

void board_parameters_seal(void) {
    seals++;
}

int main(void) {
    params_t params, before;
    params_default(&params);
    params.control.system = PLUMB_SYSTEM_QUADROTOR;
    const uint16_t hover = control_system(&params.control)->learned_parameter;
    CHECK(control_system(&params.control)->learned_word != 0U);
    before = params;
    const uint32_t outside[] = {27854U, 32767U, (uint32_t)-1};
    for (unsigned i = 0; i < sizeof outside / sizeof outside[0]; i++) {
        staging_learn(&params, hover, outside[i]);
        CHECK(params_crc32(&params) == params_crc32(&before) && seals == 0U);
    }
    staging_learn(&params, hover, 27853U);
    CHECK(params.control.attitude.aid_hover_q15 == 27853 && seals == 1U);
    params_set_word(&before, hover, 27853U);
    CHECK(params_crc32(&params) == params_crc32(&before));
    return check_failures != 0;
}
