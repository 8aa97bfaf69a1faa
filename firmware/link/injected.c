#include "injected.h"
#include <string.h>

#define NUMBER_MASK (INJECTED_NUMBERS - 1U)
#define AHEAD_MOST  31U /* numbers that a sample may be ahead of the last, whenever it comes */
#define AHEAD_EARLY 8U  /* beyond that: 8 and a quarter more than the time since the last arrival allows */

/* Gaps of 40 ms do not disarm; the outputs are neutral 50 ms after the last new sample, with pulses of 400 Hz
 * (2.5 ms) and a turn of the loop (1 ms). Slow periods get two lost samples. */
#define SILENCE_US      46000U
#define SILENCE_PERIODS 3U
#define SILENCE_MORE_US 4000U

#define SHARE_US    125000U /* half of the time over which losses are counted */
#define LOST_ONE_IN 4U      /* may be lost */
#define REPEATS_MAX 24U /* noise: 0.5 LSB rms in one channel alone repeats so often once in 20 h at 5 ms */

/* A channel is stuck after 20 equal counts, and after at least 300 ms: with noise of 0.7 LSB rms, 20 equal
 * counts in a row occur now and then. At 20 ms, the longest period that arms, that is 0.42 s. All channels
 * together are stuck after stuck_ms. */
#define STUCK_LEAST    20U
#define STUCK_LEAST_MS 300U
#define ALL_LEAST      8U

#define COUNT_12_BITS_MAX 4095
#define LEAST_COUNTS      6U

void injected_init(injected_t *in, uint8_t *marks) {
    *in = (injected_t){.marks = marks, .silent = true};
}

void injected_begin(injected_t *in) {
    memset(in->marks, 0, INJECTED_NUMBERS);
    injected_init(in, in->marks);
}

static uint32_t silence_us(uint32_t period_us) {
    const uint32_t slow_us = SILENCE_PERIODS * period_us + SILENCE_MORE_US;

    return slow_us > SILENCE_US ? slow_us : SILENCE_US;
}

/* How many numbers this one is ahead of the last that counted: 1 to 64. */
static unsigned ahead_of_last(const injected_t *in, unsigned number) {
    return in->begun ? ((number - in->number - 1U) & NUMBER_MASK) + 1U : 1U;
}

/* True when a sample is further ahead than the time since the last arrival allows. A source that replays a
 * loop of samples never pauses, so its old numbers are always too far ahead. */
static bool too_far(unsigned ahead, uint32_t period_us, uint32_t since_us) {
    const uint32_t periods = since_us / period_us;

    return ahead > AHEAD_MOST && ahead > periods + periods / 4U + AHEAD_EARLY;
}

bool injected_counts(injected_t *in, unsigned number, uint32_t period_us, uint32_t now_us, uint16_t *lost) {
    const uint32_t since_us = now_us - in->received_us;
    const bool goes_on = in->begun && since_us <= silence_us(period_us);
    const unsigned ahead = ahead_of_last(in, number);

    in->received_us = now_us;
    *lost = 0;
    if (goes_on && too_far(ahead, period_us, since_us)) {
        return false;
    }
    *lost = (uint16_t)(ahead - 1U);
    in->begun = true;
    in->number = (uint8_t)number;
    in->counted_us = now_us;
    in->lost =
        (uint16_t)(in->lost + (goes_on ? *lost : 0U)); /* after a silence the board is already disarmed */
    in->came++;
    return true;
}

void injected_spoilt(injected_t *in) {
    in->lost++;
    in->came--;
}

/* A source that replays a loop of up to 64 samples sends the same counts again with each number. */
static void compare_with_mark(injected_t *in, const int16_t *raw, unsigned counts) {
    uint32_t hash = 0;

    for (unsigned i = 0; i < counts; i++) {
        hash = 31U * hash + (uint16_t)raw[i];
    }
    const uint8_t mark = (uint8_t)((hash ^ hash >> 8) & 0xFFU);
    const bool again = mark == in->marks[in->number];

    in->repeats = (uint8_t)(!again ? 0U : in->repeats + (in->repeats < REPEATS_MAX ? 1U : 0U));
    in->marks[in->number] = mark;
}

void injected_check(injected_t *in, const int16_t raw[PLUMB_RAW_MAX], const control_system_t *system,
                    const params_t *params) {
    const bool analog =
        system->sensors == CONTROL_SENSORS_ANALOG_3 || system->sensors == CONTROL_SENSORS_ANALOG_6;
    const uint32_t stuck_ms = params->stuck_ms;
    const uint32_t longer_ms = stuck_ms == 0U || stuck_ms > STUCK_LEAST_MS ? stuck_ms : STUCK_LEAST_MS;
    const uint32_t rail = watch_limit(params->rail_ms, params->period_us, WATCH_RAIL_LEAST);
    const uint32_t stuck = watch_limit(longer_ms, params->period_us, STUCK_LEAST);
    const uint32_t all = watch_limit(stuck_ms, params->period_us, ALL_LEAST);
    bool all_stuck = true;

    compare_with_mark(in, raw, CONTROL_COUNTS_MAX == LEAST_COUNTS ? LEAST_COUNTS : system->counts);
    if (system->output == CONTROL_OUTPUT_NONE) {
        return;
    }
    for (unsigned i = 0; i < CONTROL_COUNTS_MAX; i++) {
        watch_t *const watch = &in->watches[i];

        if ((system->noisy >> i & 1U) == 0U) {
            continue;
        }
        watch_feed(watch, raw[i], analog ? 0 : INT16_MIN, analog ? COUNT_12_BITS_MAX : INT16_MAX);
        in->railed = watch_bits(in->railed, i, watch_railed(watch, rail));
        in->stuck = watch_bits(in->stuck, i, watch_stuck(watch, stuck));
        all_stuck = all_stuck && watch_stuck(watch, all);
    }
    in->stuck = all_stuck ? system->noisy : in->stuck;
}

/* Two whole shares at a time, 250 ms: a gap of 40 ms in them is 16 %. */
static void count_losses(injected_t *in, uint32_t now_us) {
    if (now_us - in->share_us < SHARE_US) {
        return;
    }
    const uint32_t lost = (uint32_t)in->lost + in->lost_before;

    in->lossy = LOST_ONE_IN * lost > lost + in->came + in->came_before;
    in->lost_before = in->lost;
    in->came_before = in->came;
    in->lost = 0;
    in->came = 0;
    in->share_us = now_us;
}

uint32_t injected_within_us(const injected_t *in, uint32_t period_us, uint32_t now_us) {
    const uint32_t since_us = now_us - in->counted_us, silent_us = silence_us(period_us);

    return since_us <= silent_us ? silent_us + 1U - since_us : 0U;
}

void injected_poll(injected_t *in, uint32_t period_us, uint32_t now_us) {
    in->silent = !in->begun || now_us - in->counted_us > silence_us(period_us);
    count_losses(in, now_us);
}

bool injected_stale(const injected_t *in) {
    return in->silent || in->lossy || in->repeats >= REPEATS_MAX;
}
