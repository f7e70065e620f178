/* Sixteen lanes of REAL, one for each pixel in a row of a tile.

REAL is float or double. A compiler keeps lanes of float in one register of 512 bits, two of 256 or
four of 128, and lanes of double in twice as many. */

#include "core.h"

enum { LANES = 16 };

#if IS_DOUBLE
typedef double REAL;
typedef int64_t BITS;
enum { FRACTION = 52, BIAS = 1023 };
#define SUFFIXED(name) name##_float64
#else
typedef float REAL;
typedef int32_t BITS;
enum { FRACTION = 23, BIAS = 127 };
#define SUFFIXED(name) name##_float32
#endif

typedef REAL lanes __attribute__((vector_size(LANES * sizeof(REAL))));
typedef BITS bits __attribute__((vector_size(LANES * sizeof(BITS))));
typedef double doubles __attribute__((vector_size(LANES * sizeof(double))));

INLINE lanes splat(double v) { return (lanes){0} + (REAL)v; }
INLINE void store(REAL *to, lanes v) { memcpy(to, &v, sizeof v); }
INLINE lanes load(const REAL *from) {
    lanes v;
    memcpy(&v, from, sizeof v);
    return v;
}

INLINE lanes chosen(bits where, lanes a, lanes b) {
    return (lanes)(((bits)a & where) | ((bits)b & ~where));
}
INLINE lanes smaller(lanes a, lanes b) { return chosen(a < b, a, b); }
INLINE lanes larger(lanes a, lanes b) { return chosen(a > b, a, b); }

INLINE lanes roots(lanes v) {
    for (int i = 0; i < LANES; i++)
        v[i] = IS_DOUBLE ? (REAL)sqrt(v[i]) : (REAL)sqrtf((float)v[i]);
    return v;
}

/* Return in lane k the sum of the lanes of v[k], for which one half is added to the other, and so
on. The other lanes are 0. */
INLINE lanes totals(const lanes *v, int count) {
    lanes sums = {0};
    for (int k = 0; k < count; k++) {
        lanes sum = v[k];
        for (int half = LANES / 2; half > 0; half /= 2)
            for (int i = 0; i < half; i++)
                sum[i] += sum[i + half];
        sums[k] = sum[0];
    }
    return sums;
}

/* Return 1 + c[0] u + c[1] u^2 + .. by Horner's rule. */
INLINE lanes polynomial(lanes u, const REAL *c, int count) {
    lanes v = splat(c[count - 1]);
    for (int k = count - 2; k >= 0; k--)
        v = u * v + splat(c[k]);
    return u * v + splat(1.0);
}
#define POLYNOMIAL(u, c) polynomial(u, c, sizeof c / sizeof *c)

/* Coefficients of exp(-q / 8) for q in 0..9, of ln(1 + u) / u on -0.25..0.5 and of 2^u on
-0.5..0.5: for float a minimax approximation or least squares, for double least squares on Chebyshev
nodes. */
#if IS_DOUBLE
static const REAL EXP[] = {-0.9999999999999957 * 0x1p-3, 0.49999999999975975 * 0x1p-6,
    -0.16666666666191254 * 0x1p-9, 0.041666666618940265 * 0x1p-12, -0.008333333050006783 * 0x1p-15,
    0.0013888878096905864 * 0x1p-18, -0.00019840993722197286 * 0x1p-21,
    2.4796730136219152e-05 * 0x1p-24, -2.7498246355397565e-06 * 0x1p-27,
    2.706659751805855e-07 * 0x1p-30, -2.236377895720017e-08 * 0x1p-33,
    1.1844917963299862e-09 * 0x1p-36};
static const REAL LOG_RATIO[] = {-0.5000000000000548, 0.3333333333331913, -0.24999999998209857,
    0.20000000000595142, -0.16666666866293955, 0.14285714556075513, -0.12499989577936857,
    0.11111081830769431, -0.10000268978114876, 0.09092107600498316, -0.0833055290284183,
    0.07669299666707963, -0.07130476727220882, 0.0685273527995908, -0.06711635413331628,
    0.05802458618907468, -0.03466566693531796, 0.009872262001040057};
static const REAL EXP2[] = {0.6931471805599501, 0.2402265069590916, 0.05550410866445849,
    0.00961812910795129, 0.0013333558228595145, 0.00015403530034444139, 1.5252658065656096e-05,
    1.321563522364695e-06, 1.0208556826465857e-07, 7.041314080487328e-09};
#else
static const REAL EXP[] = {-0.99998307f * 0x1p-3f, 0.4996931f * 0x1p-6f, -0.1650935f * 0x1p-9f,
    0.03830978f * 0x1p-12f, -0.0050456f * 0x1p-15f};
static const REAL LOG_RATIO[] = {-0.4999786647381979f, 0.3331604554922196f, -0.25090916436329785f,
    0.20691373305725377f, -0.16575104713970026f, 0.07944019106468078f};
static const REAL EXP2[] = {
    0.6931241927588543f, 0.24024098682901f, 0.055906428246032355f, 0.009582850681341234f};
#endif

/* Return exp(-q / 2) for 0 <= q <= 9, as the fourth power of exp(-q / 8). The error is at most 2e-6
for float. The relative error is at most 3e-15 for double. */
INLINE lanes exp_of_half(lanes q) {
    const lanes root = POLYNOMIAL(q, EXP), half = root * root;
    return half * half;
}

/* Return ln v of normal numbers v > 0, from v = m 2^e with 0.75 <= m < 1.5. The error is at most
3e-7 for float and 2e-15 for double, plus one rounding. */
INLINE lanes logarithms(lanes v) {
    const BITS three_quarters = ((BITS)(BIAS - 1) << FRACTION) | ((BITS)1 << (FRACTION - 1));
    const bits e = ((bits)v - three_quarters) >> FRACTION;
    const lanes u = (lanes)((bits)v - (e << FRACTION)) - (REAL)1;
    const lanes powers = __builtin_convertvector(e, lanes) * (REAL)0.6931471805599453;
    return u * POLYNOMIAL(u, LOG_RATIO) + powers;
}

/* Return 2^v, for v clipped so that this is a normal number. The relative error is at most 3e-6 for
float and 1e-15 for double, plus roundings. */
INLINE lanes powers_of_two(lanes v) {
    const REAL whole = (REAL)3 * ((BITS)1 << (FRACTION - 1)); /* + whole - whole rounds */
    v = smaller(larger(v, splat(1 - BIAS)), splat(BIAS));
    const lanes n = (v + whole) - whole;
    const bits exponent = (__builtin_convertvector(n, bits) + (BITS)BIAS) << FRACTION;
    return (lanes)exponent * POLYNOMIAL(v - n, EXP2);
}
