#include "attitude_start.h"

PART void plumb_attitude_clear_sums(plumb_attitude_t *c) {
    for (unsigned j = 0; j < 3U; j++) {
        c->rows_sum_q22[0][j] = c->rows_sum_q22[1][j] = 0;
        c->turned_sum_q28[0][j] = c->turned_sum_q28[1][j] = 0;
        c->force_sum_q18[j] = c->half_sum_q32[j] = 0;
    }
    c->tilt_added_q32 = c->velocity_added_q26 = 0;
    c->energy_q24 = 0;
    c->thrust_sum_q18[0] = c->thrust_sum_q18[1] = 0;
    c->moved = false;
}

SELDOM PART void plumb_attitude_forget(plumb_attitude_t *c, const plumb_attitude_params_t *a, int32_t bias,
                                       int32_t tilt) {
    plumb_attitude_words_t *const w = &c->words;
    w->velocity_gs_q28[0] = w->velocity_gs_q28[1] = 0;
    w->velocity_square_g2s2_q24 = 0;
    plumb_error_filter_start(&c->errors, bias, a->start_scale, tilt, a->start_speed);
    w->tilt_variance_rad2_q32 = 2U * (uint32_t)a->start_tilt;
    c->block_flags |= PLUMB_ATTITUDE_FLAG_UNSURE;
    c->held_blocks = 0;
    c->travel_gs_q28[0] = c->travel_gs_q28[1] = 0;
    c->travel_excess_q24 = c->rise_g_q18 = 0;
    c->corrected_rad_q26[0] = c->corrected_rad_q26[1] = 0;
}

SELDOM PART void plumb_attitude_start(plumb_attitude_t *c, const plumb_attitude_params_t *a) {
    for (unsigned i = 0; i < 3U; i++) {
        c->words.bias_turnps_q32[i] = c->words.scale_q32[i] = 0;
    }
    c->block_flags = PLUMB_ATTITUDE_FLAG_ALIGNING;
    plumb_attitude_forget(c, a, a->start_bias, a->start_tilt);
    c->slice = SLICE_NONE;
    c->still_blocks = c->aligned_blocks = 0;
    plumb_attitude_clear_sums(c);
}
