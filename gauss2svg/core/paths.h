/* Segments of paths, and what the coverage of paths is added to. */

#pragma once

#include "core.h"

/* A cubic with the control points p (4, 2), or the straight line between its ends. */
typedef struct {
    const double (*p)[2];
    bool is_curve;
} Segment;

/* The segments (count, 4, 2) of a path. Whether each is curved stands in (count,). */
typedef struct {
    const double (*p)[4][2];
    const bool *curved;
    int64_t count;
} Path;

/* A box of pixels, whose upper left corner is at `corner`. The sums (height, width + 2) are changes
of the winding number along each row, averaged over each pixel. */
typedef struct {
    double *sums;
    int64_t height, width;
    point corner;
} Box;

INLINE Segment segment_of(Path path, int64_t s) { return (Segment){path.p[s], path.curved[s]}; }

/* Write the derivative of a segment by t at t in 0..1, and return its point. */
INLINE point point_at(Segment segment, double t, point *along) {
    const double u = 1.0 - t;
    const point a = point_of(segment.p[0]), d = point_of(segment.p[3]);
    if (!segment.is_curve) {
        *along = d - a;
        return u * a + t * d;
    }
    const point b = point_of(segment.p[1]), c = point_of(segment.p[2]);
    *along = 3.0 * u * u * (b - a) + 6.0 * u * t * (c - b) + 3.0 * t * t * (d - c);
    return u * u * u * a + 3.0 * u * u * t * b + 3.0 * u * t * t * c + t * t * t * d;
}

void add_path(const Box *box, Path path, bool is_closed, double width, int64_t cap);
