/* The straight line or the cubic through a run of points with the least cost.

The cost is the weighted squared distance of the points from the segment, and `rate` for each byte
of path data. Points are in px. */

#include "paths.h"

enum { ROUNDS = 6 }; /* how often the places of points along a cubic are improved */
/* A weak pull to the straight line, and a least weight of points, make the equations regular. */
static const double PULL = 1e-7, LEAST_WEIGHT = 1e-5;
/* Bytes of the signs and separators of a segment: a curve, a line, a level or an upright line. */
static const double OF_CURVE = 5.5, OF_LINE = 2.3, OF_UPRIGHT = 1.0;

/* n points (n, 2) with their weights (n,), the length in px that each stands for included. `noise`
is the mean squared distance in px^2 by which points are off. Smaller distances cost little.
`places` (2 n + 2,) is a buffer. Point i is that of index i % n. */
typedef struct {
    const double (*points)[2], *weight;
    int64_t n;
    double noise, *places;
} Run;

/* A segment (4, 2), the weighted squared error of the points of its run, and its bytes. */
typedef struct {
    double p[4][2];
    bool is_curve;
    double error, bytes;
} Fit;

INLINE point of_run(const Run *run, int64_t i) { return point_of(run->points[i % run->n]); }

/* Return the error of point i, whose squared distance from its segment is d. */
INLINE double error_of(const Run *run, int64_t i, double d) {
    return run->weight[i % run->n] * d * d / (d + run->noise);
}

/* Return the number of digits of a coordinate in user units. */
static double digits(double value, double unit) {
    double count = 1.0, left = fabs(rint(value / unit));
    for (; left >= 10.0 && count < 16.0; left /= 10.0)
        count += 1.0;
    return count;
}

/* Return about how many bytes of relative path data a segment has. A user unit has `unit` px. */
static double bytes_of(Segment segment, double unit) {
    double total = segment.is_curve ? OF_CURVE : OF_LINE;
    const point by = point_of(segment.p[3]) - point_of(segment.p[0]);
    for (int i = segment.is_curve ? 1 : 3; i < 4; i++)
        for (int c = 0; c < 2; c++)
            total += digits(segment.p[i][c] - segment.p[0][c], unit);
    const bool is_upright = rint(by[0] / unit) == 0.0 || rint(by[1] / unit) == 0.0;
    return !segment.is_curve && is_upright ? total + OF_UPRIGHT - OF_LINE : total;
}

/* Write about how many bytes (count,) each of the segments (count, 4, 2) has. */
API void segment_bytes(
    int64_t count, const double (*segments)[4][2], const bool *curved, double unit, double *bytes) {
    for (int64_t s = 0; s < count; s++)
        bytes[s] = bytes_of((Segment){segments[s], curved[s]}, unit);
}

/* Set the control points of a fit. */
INLINE void set_points(Fit *fit, point a, point b, point c, point d) {
    const point p[4] = {a, b, c, d};
    memcpy(fit->p, p, sizeof p);
}

/* Return the straight line between points first..last. */
static Fit line_between(const Run *run, int64_t first, int64_t last) {
    Fit fit = {.is_curve = false};
    const point a = of_run(run, first), d = of_run(run, last), along = d - a;
    set_points(&fit, a, a, d, d);
    for (int64_t i = first; i <= last; i++) {
        const point v = of_run(run, i) - a;
        const double t = clip(dot(v, along) / max(dot(along, along), 1e-9), 0.0, 1.0);
        fit.error += error_of(run, i, dot(v - t * along, v - t * along));
    }
    return fit;
}

/* Return the cubic between points first..last with the least weighted squared error.

For places t of the points, the handles b and c solve two normal equations. Each round then moves
the places by a step of Newton's method towards the nearest points of the curve. */
static Fit cubic_between(const Run *run, int64_t first, int64_t last) {
    const int64_t count = last - first + 1;
    const point a = of_run(run, first), d = of_run(run, last);
    double *t = run->places, whole = 0.0;
    Fit fit = {.is_curve = true};
    for (int64_t i = 0; i < count; i++) {
        whole += i > 0 ? length(of_run(run, first + i) - of_run(run, first + i - 1)) : 0.0;
        t[i] = whole;
    }
    set_points(&fit, a, a, d, d);
    if (whole < 1e-6)
        return fit;
    for (int64_t i = 0; i < count; i++)
        t[i] /= whole;
    for (int round = 0; round < ROUNDS; round++) {
        const double pull = PULL * whole;
        double bb = pull, bc = 0.0, cc = pull;
        point rb = pull * (2.0 * a + d) / 3.0, rc = pull * (a + 2.0 * d) / 3.0;
        for (int64_t i = 0; i < count; i++) {
            const double u = 1.0 - t[i], b1 = 3.0 * u * u * t[i], b2 = 3.0 * u * t[i] * t[i];
            const double g = run->weight[(first + i) % run->n] + LEAST_WEIGHT;
            const point rest = of_run(run, first + i) - u * u * u * a - t[i] * t[i] * t[i] * d;
            bb += g * b1 * b1;
            bc += g * b1 * b2;
            cc += g * b2 * b2;
            rb += g * b1 * rest;
            rc += g * b2 * rest;
        }
        const double det = max(bb * cc - bc * bc, 1e-14);
        set_points(&fit, a, (cc * rb - bc * rc) / det, (bb * rc - bc * rb) / det, d);
        fit.error = 0.0;
        for (int64_t i = 0; i < count; i++) {
            point along;
            const point on = point_at((Segment){fit.p, true}, t[i], &along);
            const point off = on - of_run(run, first + i);
            const double speed = dot(along, along);
            fit.error += error_of(run, first + i, dot(off, off));
            if (round < ROUNDS - 1 && 0 < i && i < count - 1 && speed > 1e-9)
                t[i] = clip(t[i] - dot(off, along) / speed, 0.0, 1.0);
        }
    }
    return fit;
}

/* Fit the cheaper of a line and a cubic to the points run[0]..run[1].

n, points, weight, noise, places  as in Run
run          (2,) indices of points, any whole numbers. The first one is not larger
only_curves  whether lines are left out
unit, rate   user unit in px, and squared error that a byte must save
segment, result  (4, 2) output, and (3,) output: whether it is curved, its error and its bytes */
API void fit_run(int64_t n, const double (*points)[2], const double *weight, double noise,
    double *places, const int64_t *run, int64_t only_curves, double unit, double rate,
    double (*segment)[2], double *result) {
    const Run all = {points, weight, n, noise, places};
    const int64_t begin = (run[0] % n + n) % n, end = begin + run[1] - run[0];
    Fit best = cubic_between(&all, begin, end);
    best.bytes = bytes_of((Segment){best.p, true}, unit);
    if (!only_curves) {
        Fit line = line_between(&all, begin, end);
        line.bytes = bytes_of((Segment){line.p, false}, unit);
        if (line.error + rate * line.bytes < best.error + rate * best.bytes)
            best = line;
    }
    memcpy(segment, best.p, sizeof best.p);
    result[0] = best.is_curve;
    result[1] = best.error;
    result[2] = best.bytes;
}
