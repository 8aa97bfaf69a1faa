#include "control.h"

typedef char control_assert_words[sizeof(control_params_t) == 416 ? 1 : -1];

void control_init(control_t *c, const control_params_t *p) {
    switch (p->system) {
    case CONTROL_BALANCER:
        balancer_init(&c->balancer, p);
        break;
    case CONTROL_PHONE:
        phone_init(&c->phone, p);
        break;
    case CONTROL_TURNTABLE:
        turntable_init(&c->turntable, p);
        break;
    default:
        quad_init(&c->quad, p);
    }
}

void control_step(control_t *c, const control_params_t *p, const int16_t raw[CONTROL_RAW_MAX],
                  int32_t setpoint) {
    if (__builtin_expect(p->system == CONTROL_QUAD, 1)) { /* the one whose cycles have a budget */
        quad_step(&c->quad, p, raw, setpoint);
        return;
    }
    switch (p->system) {
    case CONTROL_BALANCER:
        balancer_step(&c->balancer, p, raw, setpoint);
        break;
    case CONTROL_PHONE:
        phone_step(&c->phone, p, raw, setpoint);
        break;
    case CONTROL_TURNTABLE:
        turntable_step(&c->turntable, p, raw, setpoint);
        break;
    default:
        break; /* control_params_valid() lets no other pass */
    }
}

bool control_params_valid(const control_params_t *p) {
    switch (p->system) {
    case CONTROL_QUAD:
        return quad_params_valid(p);
    case CONTROL_BALANCER:
        return balancer_params_valid(p);
    case CONTROL_PHONE:
        return phone_params_valid(p);
    case CONTROL_TURNTABLE:
        return turntable_params_valid(p);
    default:
        return false;
    }
}

const void *control_words(const control_t *c) {
    return c;
}

size_t control_words_bytes(const control_params_t *p) {
    switch (p->system) {
    case CONTROL_BALANCER:
        return sizeof(balancer_words_t);
    case CONTROL_PHONE:
        return sizeof(phone_words_t);
    case CONTROL_TURNTABLE:
        return sizeof(turntable_words_t);
    default:
        return sizeof(quad_words_t);
    }
}

const plausibility_bounds_t *control_plausibility(const control_params_t *p) {
    switch (p->system) {
    case CONTROL_QUAD:
        return &quad_plausibility;
    case CONTROL_BALANCER:
        return &balancer_plausibility;
    default:
        return NULL;
    }
}

bool control_saturated(const control_t *c, const control_params_t *p) {
    switch (p->system) {
    case CONTROL_BALANCER:
        return (c->balancer.words.flags & BALANCER_FLAGS_SATURATED) != 0;
    case CONTROL_PHONE:
        return (c->phone.words.flags & PHONE_FLAGS_SATURATED) != 0;
    case CONTROL_TURNTABLE:
        return (c->turntable.words.flags & TURNTABLE_FLAGS_SATURATED) != 0;
    default:
        return (c->quad.words.flags & QUAD_FLAGS_SATURATED) != 0;
    }
}
