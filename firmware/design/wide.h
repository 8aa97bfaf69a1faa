/* Numbers of 106 bits as the sum of two doubles: sums, products and quotients within 2^-102 of themselves.
 *
 * Dekker, "A floating-point technique for extending the available precision" (1971), and Knuth's exact sum.
 * It needs IEEE doubles rounded to nearest, nothing contracted and no excess precision; magnitudes stay
 * between 2^-900 and 2^900, or are 0. Builds that know no flags, such as the Arduino IDE's, get it from the
 * pragmas; other compilers need -ffp-contract=off or the like.
 */
#ifndef PLUMB_DESIGN_WIDE_H
#define PLUMB_DESIGN_WIDE_H

#include <float.h>
#include <stdint.h>

#if defined(__FAST_MATH__)
#error "plumb's design needs IEEE arithmetic: compile these files without -ffast-math"
#endif
#if FLT_EVAL_METHOD != 0
#error "plumb's design needs doubles without excess precision: on 32-bit x86 give -msse2 -mfpmath=sse"
#endif

#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__)
#pragma GCC optimize("fp-contract=off")
#endif

typedef struct {
    double hi, lo; /* |lo| is at most half a unit in the last place of hi */
} wide_t;

static inline wide_t wide_of(double x) {
    const wide_t w = {x, 0.0};
    return w;
}

/* a + b, exact. */
static inline wide_t wide_sum(double a, double b) {
    const double s = a + b, v = s - a;
    const wide_t w = {s, (a - (s - v)) + (b - v)};
    return w;
}

/* a b, exact: each factor in two halves of 26 bits. */
static inline wide_t wide_product(double a, double b) {
    const double ca = 134217729.0 * a, cb = 134217729.0 * b; /* 2^27 + 1 */
    const double a1 = ca - (ca - a), a2 = a - a1, b1 = cb - (cb - b), b2 = b - b1, p = a * b;
    const wide_t w = {p, ((a1 * b1 - p) + a1 * b2 + a2 * b1) + a2 * b2};
    return w;
}

static inline wide_t wide_add(wide_t a, wide_t b) {
    const wide_t s = wide_sum(a.hi, b.hi), t = wide_sum(a.lo, b.lo);
    const wide_t u = wide_sum(s.hi, s.lo + t.hi);
    return wide_sum(u.hi, u.lo + t.lo);
}

static inline wide_t wide_neg(wide_t a) {
    const wide_t w = {-a.hi, -a.lo};
    return w;
}

static inline wide_t wide_sub(wide_t a, wide_t b) {
    return wide_add(a, wide_neg(b));
}

static inline wide_t wide_mul(wide_t a, wide_t b) {
    const wide_t p = wide_product(a.hi, b.hi);
    return wide_sum(p.hi, p.lo + (a.hi * b.lo + a.lo * b.hi));
}

/* b is not 0. Exact where the quotient is a double. */
static inline wide_t wide_div(wide_t a, wide_t b) {
    const double q1 = a.hi / b.hi;
    const wide_t r1 = wide_sub(a, wide_mul(b, wide_of(q1)));
    const double q2 = r1.hi / b.hi;
    const wide_t r2 = wide_sub(r1, wide_mul(b, wide_of(q2)));
    return wide_add(wide_sum(q1, q2), wide_of(r2.hi / b.hi));
}

/* Below 0, 0 or above 0 as a is less than b, equal to it or more. */
static inline int wide_compare(wide_t a, wide_t b) {
    const wide_t d = wide_sub(a, b);
    const double sign = d.hi != 0.0 ? d.hi : d.lo;
    return (sign > 0.0) - (sign < 0.0);
}

static inline wide_t wide_abs(wide_t a) {
    return a.hi < 0.0 ? wide_neg(a) : a;
}

/* Exact up to +-2^62. */
static inline wide_t wide_of_int(int64_t x) {
    const double hi = (double)x;
    const wide_t w = {hi, (double)(x - (int64_t)hi)};
    return w;
}

/* The largest integer that is not above a; further than 2^9 beyond +-2^62 it stays at +-2^62. *fraction: what
 * is left, 0 to 1. */
static inline int64_t wide_floor(wide_t a, wide_t *fraction) {
    const double limit = 4611686018427387904.0; /* 2^62 */
    *fraction = wide_of(0.0);
    if (a.hi > limit || a.hi < -limit) { /* at the limit itself lo counts */
        return a.hi > 0.0 ? (int64_t)1 << 62 : -((int64_t)1 << 62);
    }
    const int64_t i = (int64_t)a.hi, j = (int64_t)a.lo;
    const wide_t rest = wide_sum(a.hi - (double)i, a.lo - (double)j); /* above -2, below 2 */
    int64_t k = -2;
    while (wide_compare(rest, wide_of((double)(k + 1))) >= 0) {
        k++;
    }
    *fraction = wide_sub(rest, wide_of((double)k));
    return i + j + k;
}

/* The nearest integer, of two the even one. */
static inline int64_t wide_round(wide_t a) {
    wide_t fraction;
    const int64_t below = wide_floor(a, &fraction);
    const int side = wide_compare(fraction, wide_of(0.5));
    return below + (side > 0 || (side == 0 && (below % 2) != 0) ? 1 : 0);
}

#endif
