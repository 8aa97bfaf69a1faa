#include "arming.h"

void arming_init(arming_t *a, uint32_t random) {
    *a = (arming_t){.switch_closed = true /* until it was seen open */, .number = (uint16_t)(random >> 16)};
}

bool arming_armed(const arming_t *a) {
    return a->armed.word == ARMING_ARMED;
}

bool arming_driving(const arming_t *a) {
    return arming_armed(a) && a->driving.word == ARMING_DRIVING;
}

static void arm(arming_t *a, bool by_switch, uint32_t hold_us, uint32_t now_us) {
    a->armed.word = ARMING_ARMED;
    a->driving.word = 0;
    a->by_switch = by_switch;
    a->cause = 0;
    a->number = (uint16_t)(a->number < UINT16_MAX ? a->number + 1U : 1U);
    a->keepalive_us = now_us;
    a->armed_us = now_us;
    a->hold_us = hold_us;
}

bool arming_arm(arming_t *a, uint16_t blocked, uint32_t hold_us, uint32_t now_us) {
    if (blocked != 0) {
        return false;
    }
    arm(a, false, hold_us, now_us);
    keepalive_begin(&a->keepalive, now_us);
    return true;
}

uint32_t arming_issue(arming_t *a, random_t *random, uint32_t now_us) {
    return arming_armed(a) && !a->by_switch ? keepalive_issue(&a->keepalive, random, now_us) : 0U;
}

bool arming_switch(arming_t *a, bool closed, uint32_t now_us) {
    if (!closed && a->by_switch) {
        arming_disarm(a, ARMING_BLOCK_SWITCH);
    }
    if (closed != a->switch_closed) {
        a->switch_closed = closed;
        a->switch_us = now_us;
    }
    a->switch_trying = a->switch_trying && closed;
    if (now_us - a->switch_us < ARMING_SWITCH_US || a->switch_ready != closed) {
        return false;
    }
    a->switch_ready = !closed;
    a->switch_trying = closed;
    a->switch_settling = false;
    a->switch_try_us = now_us;
    return closed;
}

void arming_switch_unread(arming_t *a) {
    a->switch_closed = true;
    a->switch_ready = false;
    a->switch_trying = false;
}

bool arming_switch_used_up(const arming_t *a) {
    return a->switch_closed && !a->switch_ready && !a->switch_trying;
}

uint16_t arming_switch_owns(const arming_t *a) {
    const bool used_up = arming_switch_used_up(a);

    return used_up && (a->by_switch || !arming_armed(a)) ? ARMING_BLOCK_SWITCH_OWNS : 0U;
}

void arming_try_switch(arming_t *a, uint16_t blocked, uint32_t ready_us, uint32_t hold_us, uint32_t now_us) {
    if (!a->switch_trying) {
        return;
    }
    const unsigned matters = blocked & ~ARMING_BLOCKS_HOST;
    const bool settling = matters == ARMING_BLOCK_NOT_READY || (matters == 0 && a->switch_settling);
    const uint32_t limit_us = settling ? ready_us : ARMING_SWITCH_TRY_US;

    a->switch_settling = matters == ARMING_BLOCK_NOT_READY;
    if (arming_armed(a) || now_us - a->switch_try_us > limit_us) {
        a->switch_trying = false;
    } else if (matters == 0) {
        a->switch_trying = false;
        arm(a, true, hold_us, now_us);
    }
}

static bool silent(const arming_t *a, uint32_t now_us) {
    return !a->by_switch && now_us - a->keepalive_us > ARMING_SILENCE_US;
}

bool arming_keepalive(arming_t *a, uint16_t number, uint32_t value, uint32_t now_us) {
    if (!arming_armed(a) || a->by_switch || number != a->number ||
        !keepalive_counts(&a->keepalive, value, now_us)) {
        return false;
    }
    /* A late keep-alive must not keep the board armed, even when it comes before the poll that disarms. The
     * poll also knows whether the loop itself stood still: then that is the cause. */
    if (silent(a, now_us)) {
        return false;
    }
    a->keepalive_us = now_us;
    return true;
}

void arming_disarm(arming_t *a, uint16_t cause) {
    if (arming_armed(a)) {
        a->armed.word = 0;
        a->driving.word = 0;
        a->cause = cause;
    }
}

void arming_disarm_host(arming_t *a, uint16_t cause) {
    if (!a->by_switch) {
        arming_disarm(a, cause);
    }
}

/* Time left of `us` since `since_us`; 0 when they have passed. */
static uint32_t left_us(uint32_t us, uint32_t since_us, uint32_t now_us) {
    const uint32_t passed_us = now_us - since_us;

    return passed_us < us ? us - passed_us : 0U;
}

static uint32_t earlier(uint32_t a_us, uint32_t b_us) {
    return a_us < b_us ? a_us : b_us;
}

uint32_t arming_within_us(const arming_t *a, uint32_t now_us) {
    uint32_t within_us = UINT32_MAX;

    if (!arming_driving(a)) {
        within_us = left_us(a->hold_us, a->armed_us, now_us);
    }
    if (!a->by_switch) {
        within_us = earlier(within_us, left_us(ARMING_SILENCE_US + 1U, a->keepalive_us, now_us));
        within_us = earlier(within_us, left_us(KEEPALIVE_PERIOD_US, a->keepalive.last_us, now_us));
    }
    return within_us;
}

void arming_poll(arming_t *a, uint16_t blocked, uint32_t now_us) {
    const uint16_t matters = a->by_switch ? (uint16_t)(blocked & ~ARMING_BLOCKS_HOST) : blocked;

    if (matters != 0) {
        arming_disarm(a, matters);
    }
    if (silent(a, now_us)) {
        arming_disarm(a, ARMING_BLOCK_SILENCE);
    }
    /* arming_driving() keeps the hold over when the clock wraps. */
    const bool held = arming_driving(a) || now_us - a->armed_us >= a->hold_us;

    a->driving.word = arming_armed(a) && held ? ARMING_DRIVING : 0U;
}
