/* Elementary functions, which differ in the last bits from C library to C library.

All are sums and products of doubles in a fixed order. "ulp" is a unit in the last place of the
result. Series are Taylor's, by Horner's rule, after the argument was reduced. */

#pragma once

#include "core.h"

/* Two parts of ln 2 and three of pi / 2. The first of each has so few bits that its products with
whole numbers up to 2^20 are exact. */
static const double LN2[] = {0x1.62e42feep-1, 0x1.a39ef35793c76p-33};
static const double HALF_PI[] = {0x1.921fb544p+0, 0x1.0b4611a6p-34, 0x1.3198a2e037073p-69};

typedef union {
    double number;
    int64_t bits;
} Double;
INLINE double double_of(int64_t bits) { return (Double){.bits = bits}.number; }
INLINE int64_t bits_of(double v) { return (Double){v}.bits; }

/* Return e^x 2^n for |n| <= 3000, with an error of 1.2 ulp. */
INLINE double scaled_exp(double x, double n) {
    const double whole = 0x1.8p52; /* + whole - whole rounds */
    const double k = (clip(x, -5000.0, 5000.0) * 0x1.71547652b82fep+0 + whole) - whole;
    const double r = (x - k * LN2[0]) - k * LN2[1];
    double v = 1.0;
    for (int i = 13; i > 0; i--)
        v = v * (r * (1.0 / i)) + 1.0;
    /* Two factors, because 2^exponent may be out of range where the result is not. */
    const int64_t exponent = bits_of(clip(k + n, -2000.0, 2000.0) + whole) - bits_of(whole);
    const int64_t half = exponent >> 1;
    v *= double_of((half + 1023) << 52);
    v *= double_of((exponent - half + 1023) << 52);
    return x != x ? x : x > 5000.0 ? INFINITY : x < -5000.0 ? 0.0 : v;
}

/* Return e^x, with an error of 1.2 ulp. */
INLINE double exponential(double x) { return scaled_exp(x, 0.0); }

/* Split v > 0 into m and e, so that v is m 2^e and sqrt(1/2) <= m < sqrt(2). Return m - 1. */
INLINE double fraction_of(double v, double *e) {
    const bool is_tiny = v < 0x1p-1022;
    /* Unsigned numbers may wrap around, as they do for v < 0. */
    const uint64_t bits = (uint64_t)bits_of(is_tiny ? v * 0x1p54 : v);
    const int64_t k = (int64_t)(bits - (uint64_t)bits_of(0x1.6a09e667f3bcdp-1)) >> 52;
    *e = (double)(k - (is_tiny ? 54 : 0));
    return double_of((int64_t)(bits - ((uint64_t)k << 52))) - 1.0;
}

/* Return ln(1 + f) for sqrt(1/2) <= 1 + f < sqrt(2), from 2 artanh(s) with s = f / (2 + f), plus
`small`, which is much smaller. */
INLINE double near_one(double f, double small) {
    const double s = f / (2.0 + f), z = s * s;
    double v = 0.0;
    for (int i = 11; i > 0; i--)
        v = z * (v + 2.0 / (2 * i + 1));
    return f - (s * (f - v) - small);
}

/* Return ln v, with an error of 1.2 ulp. It is -infinity for 0, and not a number below. */
INLINE double logarithm(double v) {
    double e;
    const double f = fraction_of(v, &e);
    const double result = e * LN2[0] + near_one(f, e * LN2[1]);
    return v > 0.0 && v < INFINITY ? result : v == 0.0 ? -INFINITY : v > 0.0 ? v : NAN;
}

/* Return v^y for v >= 0. The error is 1 + |y ln v| ulp. Powers of two are exact if they are whole
numbers or their inverses. */
INLINE double power(double v, double y) {
    double e;
    const double f = fraction_of(v, &e), n = rint(y * e);
    const double result = scaled_exp((y * e - n) * (LN2[0] + LN2[1]) + y * near_one(f, 0.0), n);
    if (v > 0.0 && v < INFINITY && fabs(n) <= 3000.0)
        return result;
    return y == 0.0 ? 1.0 : exponential(y * logarithm(v));
}

/* Return the cosine of x - quarters pi / 2 for |x| <= 1e6, with an error of 2e-16. It is the sine
for quarters = 1. */
INLINE double cosine_from(double x, double quarters) {
    const double whole = 0x1.8p52;
    const double n = (x * 0x1.45f306dc9c883p-1 + whole) - whole;
    const double r = ((x - n * HALF_PI[0]) - n * HALF_PI[1]) - n * HALF_PI[2], z = r * r;
    double sine = 1.0, cosine = 1.0;
    for (int i = 9; i > 0; i--) {
        sine = 1.0 - z * (1.0 / (2 * i * (2 * i + 1))) * sine;
        cosine = 1.0 - z * (1.0 / (2 * i * (2 * i - 1))) * cosine;
    }
    sine *= r;
    const double turns = 0.25 * (n - quarters), quarter = turns - floor(turns); /* 0 to 0.75 */
    const double v = quarter == 0.0 || quarter == 0.5 ? cosine : sine;
    return quarter == 0.25 || quarter == 0.5 ? -v : v;
}
INLINE double cosine(double x) { return cosine_from(x, 0.0); }
INLINE double sine(double x) { return cosine_from(x, 1.0); }

/* Return the angle of the point (x, y) in -pi..pi, with an error of 5 ulp. */
INLINE double angle_of(double y, double x) {
    const double u = fabs(x), v = fabs(y), larger = max(u, v);
    const double t = larger > 0.0 ? min(u, v) / larger : 0.0;
    /* arctan t is 4 arctan h, where tangents of half angles are found twice. */
    const double g = t / (1.0 + sqrt(1.0 + t * t)), h = g / (1.0 + sqrt(1.0 + g * g)), z = h * h;
    double w = 0.0;
    for (int i = 11; i > 0; i--)
        w = z * (1.0 / (2 * i + 1) - w);
    double angle = 4.0 * (h - h * w);
    angle = v > u ? HALF_PI[0] - angle + HALF_PI[1] : angle;
    angle = signbit(x) ? 2.0 * HALF_PI[0] - angle + 2.0 * HALF_PI[1] : angle;
    return x != x || y != y ? NAN : copysign(angle, y);
}
