/* In place of arming.c, where no system of the image drives anything: it never arms, and no switch does. */
#include "arming.h"

void arming_init(arming_t *a, uint32_t random) {
    (void)a, (void)random;
}

bool arming_armed(const arming_t *a) {
    (void)a;
    return false;
}

bool arming_driving(const arming_t *a) {
    (void)a;
    return false;
}

bool arming_arm(arming_t *a, uint16_t blocked, uint32_t hold_us, uint32_t now_us) {
    (void)a, (void)blocked, (void)hold_us, (void)now_us;
    return false;
}

uint32_t arming_issue(arming_t *a, random_t *random, uint32_t now_us) {
    (void)a, (void)random, (void)now_us;
    return 0;
}

bool arming_switch(arming_t *a, bool closed, uint32_t now_us) {
    (void)a, (void)closed, (void)now_us;
    return false;
}

void arming_switch_unread(arming_t *a) {
    (void)a;
}

bool arming_switch_used_up(const arming_t *a) {
    (void)a;
    return false;
}

uint16_t arming_switch_owns(const arming_t *a) {
    (void)a;
    return 0;
}

void arming_try_switch(arming_t *a, uint16_t blocked, uint32_t ready_us, uint32_t hold_us, uint32_t now_us) {
    (void)a, (void)blocked, (void)ready_us, (void)hold_us, (void)now_us;
}

bool arming_keepalive(arming_t *a, uint16_t number, uint32_t value, uint32_t now_us) {
    (void)a, (void)number, (void)value, (void)now_us;
    return false;
}

void arming_disarm(arming_t *a, uint16_t cause) {
    (void)a, (void)cause;
}

void arming_disarm_host(arming_t *a, uint16_t cause) {
    (void)a, (void)cause;
}

void arming_poll(arming_t *a, uint16_t blocked, uint32_t now_us) {
    (void)a, (void)blocked, (void)now_us;
}

uint32_t arming_within_us(const arming_t *a, uint32_t now_us) {
    (void)a, (void)now_us;
    return UINT32_MAX;
}
