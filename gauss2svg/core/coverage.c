/* Exact coverage of pixels by areas and lines.

A curve is replaced by a polygon, and a line by the polygons of its stroke. The edges of polygons
are then added up row by row. An edge changes the coverage of the pixels that it crosses by a part
of its height, and of all pixels to the right of these by its whole height. The running sum along a
row is the winding number, averaged over each pixel. Its absolute value, at most 1, is the coverage.
So a hole is an outline that runs the other way.

Where outlines or strokes overlap themselves, a pixel that each part covers in part counts both. So
a stroke is too dark in a few pixels where it crosses itself, or turns within its width.

Points are in px. */

#include "functions.h"
#include "paths.h"

static const double SAGITTA = 0.01;    /* largest distance in px of a curve from its polygon */
static const double MITER_LIMIT = 4.0; /* largest ratio of a mitre to the width (SVG's default) */
static const double LEAST_GAP = 0.01;  /* px; a narrower gap between two segments needs no join */
static const double STEEPEST = 1e30;   /* an edge with a larger ratio of x to y is horizontal */
enum { BUTT, ROUND, SQUARE };          /* caps. Joins of round ends are round, others are mitred */

/* Add to a row the change of the winding number along an edge that runs from left to right px
within it, and has the height `delta`. The part of each pixel right of the edge is a trapezium. */
static void add_to_row(double *row, double left, double right, double delta) {
    const double width = right - left;
    double from = left, to;
    int64_t x = (int64_t)left;
    do {
        to = min(right, (double)x + 1.0);
        const double share = 0.5 * (from + to) - (double)x;
        const double part = width > 0.0 ? delta * ((to - from) / width) : delta;
        row[x] += part * (1.0 - share);
        row[++x] += part * share;
        from = to;
    } while (to < right);
}

/* Add the edge from a to b. */
static void add_edge(const Box *box, point a, point b) {
    a -= box->corner;
    b -= box->corner;
    /* This is false for horizontal edges, and for coordinates that are not numbers. */
    if (!(fabs(b[0] - a[0]) < STEEPEST * fabs(b[1] - a[1])))
        return;
    const double turn = a[1] > b[1] ? -1.0 : 1.0, w = (double)box->width;
    if (turn < 0.0) {
        const point swapped = a;
        a = b;
        b = swapped;
    }
    if (b[1] <= 0.0 || a[1] >= (double)box->height)
        return;
    const double slope = (b[0] - a[0]) / (b[1] - a[1]), top = max(a[1], 0.0);
    const double bottom = min(b[1], (double)box->height);
    double x = a[0] + (top - a[1]) * slope;
    for (int64_t y = (int64_t)top; y < (int64_t)ceil(bottom); y++) {
        double *row = box->sums + y * (box->width + 2);
        const double height = min((double)y + 1.0, bottom) - max((double)y, top);
        const double next_x = x + slope * height, low = min(x, next_x), high = max(x, next_x);
        const double left = clip(low, 0.0, w), right = clip(high, 0.0, w);
        double delta = height * turn;
        x = next_x;
        if (right - left < high - low) {
            /* The part left of the box changes all of the row, the part right of it nothing. */
            const double per_px = delta / (high - low);
            row[0] += per_px * max(min(high, 0.0) - low, 0.0);
            delta = per_px * (right - left);
        }
        add_to_row(row, left, right, delta);
    }
}

/* Return the number of edges by which a segment is drawn. `half` is half the width of its stroke,
or 0 for the segment itself.

The distance of a curve B from n edges is at most max |B''| / (8 n^2), and B'' is at most six times
the second differences of the control points. The outer side of a stroke bends like its curve, but
is longer by the factor 1 + half / radius, with the radius |B'|^2 / |B''|. */
static int64_t edge_count(Segment segment, double half) {
    if (!segment.is_curve)
        return 1;
    const point a = point_of(segment.p[0]), b = point_of(segment.p[1]);
    const point c = point_of(segment.p[2]), d = point_of(segment.p[3]);
    const double whole = length(b - a) + length(c - b) + length(d - c);
    const double bend = max(length(c - 2.0 * b + a), length(d - 2.0 * c + b)), turn = bend / whole;
    if (whole == 0.0)
        return 1;
    return (int64_t)sqrt(0.75 / SAGITTA * (bend + 6.0 * half * turn * turn)) + 1;
}

/* Return the unit tangent of a segment at t in 0..1.

Where a handle lies on its node, the derivative is 0. A point a little further on then gives the
tangent. A segment without extent has the tangent (1, 0). */
static point direction_at(Segment segment, double t) {
    point along;
    point_at(segment, t, &along);
    if (length(along) < 1e-9)
        point_at(segment, t + (t < 0.5 ? 1e-3 : -1e-3), &along);
    return length(along) == 0.0 ? at(1.0, 0.0) : along / length(along);
}

/* Return the point `offset` px beside a segment at t in 0..1, on its right side if y is down. */
static point beside(Segment segment, double t, double offset) {
    point along;
    return point_at(segment, t, &along) + offset * turned(direction_at(segment, t));
}

/* Add the edges of a closed outline. */
static void add_outline(const Box *box, Path path) {
    point along;
    for (int64_t s = 0; s < path.count; s++) {
        const Segment segment = segment_of(path, s);
        const int64_t count = edge_count(segment, 0.0);
        point from = point_of(segment.p[0]);
        for (int64_t i = 1; i <= count; i++) {
            const point to = point_at(segment, (double)i / (double)count, &along);
            add_edge(box, from, to);
            from = to;
        }
    }
}

/* Add an arc around a centre between two unit directions, on the shorter way, and its hub. The
polygon runs from the hub to the arc, along it, and back. All parts of a stroke turn the same way,
so that none is a hole in another. */
static void add_fan(const Box *box, point centre, point from, point to, double radius, point hub) {
    const double signed_turn = angle_of(cross(from, to), dot(from, to)), turn = fabs(signed_turn);
    const point begin = signed_turn < 0.0 ? to : from;
    const int64_t count = (int64_t)(turn * sqrt(radius / (8.0 * SAGITTA))) + 1;
    point before = hub;
    for (int64_t i = 0; i <= count; i++) {
        const double angle = turn * (double)i / (double)count;
        const point next = centre + radius * (begin * cosine(angle) + turned(begin) * sine(angle));
        add_edge(box, before, next);
        before = next;
    }
    add_edge(box, before, hub);
}

/* Add the cap of a stroke that ends at `end` in the unit direction u. */
static void add_cap(const Box *box, point end, point u, double half, int64_t cap) {
    const point n = -half * turned(u), far = end + half * u;
    if (cap == ROUND) {
        add_fan(box, end, -turned(u), u, half, end);
        add_fan(box, end, u, turned(u), half, end);
    } else if (cap == SQUARE) {
        add_edge(box, end - n, end + n);
        add_edge(box, end + n, far + n);
        add_edge(box, far + n, far - n);
        add_edge(box, far - n, end - n);
    }
}

/* Where the left and the right side of a stroke end on a segment, and where they start on the next
one: values of t. */
typedef struct {
    double left, right, next_left, next_right;
} Cuts;
static const Cuts WHOLE = {1.0, 1.0, 0.0, 0.0};

/* Return where the inner sides of a stroke meet between two segments, by Newton's method. There the
polygons of both end, so that they do not overlap. If the sides do not meet within half of each
segment, nothing is cut. */
static Cuts inner_cuts(Segment first, Segment second, double half) {
    const bool is_left = cross(direction_at(first, 1.0), direction_at(second, 0.0)) > 0.0;
    const double inner = is_left ? half : -half;
    double a = 1.0, b = 0.0;
    for (int round = 0; round < 6; round++) {
        const point p = beside(first, a, inner), q = beside(second, b, inner), gap = q - p;
        if (fabs(gap[0]) + fabs(gap[1]) < 1e-6)
            return is_left ? (Cuts){a, 1.0, b, 0.0} : (Cuts){1.0, a, 0.0, b};
        const point by_a = 1e4 * (p - beside(first, a - 1e-4, inner));
        const point by_b = 1e4 * (beside(second, b + 1e-4, inner) - q);
        a += cross(gap, by_b) / cross(by_a, by_b);
        b += cross(gap, by_a) / cross(by_a, by_b);
        if (!(0.5 <= a && a <= 1.0 && 0.0 <= b && b <= 0.5))
            break;
    }
    return WHOLE;
}

/* Add what lies on the outer side between two segments, of unit directions u and v, at `node`. The
polygons of both segments end at the point `hub`. */
static void add_join(
    const Box *box, point node, point u, point v, double half, point hub, bool is_round) {
    const double turn = angle_of(cross(u, v), dot(u, v));
    if (fabs(turn) * half < LEAST_GAP)
        return;
    /* Now the stroke comes along u, turns to the left, and leaves along v. */
    const point from = turn < 0.0 ? -v : u, to = turn < 0.0 ? -u : v;
    if (is_round) {
        add_fan(box, node, -turned(from), -turned(to), half, hub);
        return;
    }
    point p = node - half * turned(from);
    const point q = node - half * turned(to);
    add_edge(box, hub, p);
    if (cosine(0.5 * turn) * MITER_LIMIT >= 1.0) {
        const point tip = p + half * (sine(0.5 * fabs(turn)) / cosine(0.5 * turn)) * from;
        add_edge(box, p, tip);
        p = tip;
    }
    add_edge(box, p, q);
    add_edge(box, q, hub);
}

/* Add the stroke along one outline, whose segments each have an extent. */
static void add_stroke(const Box *box, Path path, bool is_closed, double width, int64_t cap) {
    const double half = 0.5 * width;
    Segment before = segment_of(path, path.count - 1);
    Cuts cuts = is_closed ? inner_cuts(before, segment_of(path, 0), half) : WHOLE;
    for (int64_t s = 0; s < path.count; s++) {
        const Segment segment = segment_of(path, s);
        const bool is_end = s == path.count - 1 && !is_closed;
        const point node = point_of(segment.p[0]), u = direction_at(segment, 0.0);
        if (s > 0 || is_closed) {
            const point hub = cuts.left < 1.0    ? beside(before, cuts.left, half)
                              : cuts.right < 1.0 ? beside(before, cuts.right, -half)
                                                 : node;
            add_join(box, node, direction_at(before, 1.0), u, half, hub, cap == ROUND);
        } else {
            add_cap(box, node, -u, half, cap);
        }
        /* The polygon of the segment goes along its right side and back along its left side. */
        const double first_left = cuts.next_left, first_right = cuts.next_right;
        cuts = is_end ? WHOLE : inner_cuts(segment, segment_of(path, (s + 1) % path.count), half);
        const int64_t edges = edge_count(segment, half);
        point left = beside(segment, first_left, half), right = beside(segment, first_right, -half);
        add_edge(box, left, right);
        for (int64_t i = 1; i <= edges; i++) {
            const double t = (double)i / (double)edges;
            const point p = beside(segment, clip(t, first_left, cuts.left), half);
            const point q = beside(segment, clip(t, first_right, cuts.right), -half);
            add_edge(box, right, q);
            add_edge(box, p, left);
            left = p;
            right = q;
        }
        add_edge(box, right, left);
        if (is_end)
            add_cap(box, point_of(segment.p[3]), direction_at(segment, 1.0), half, cap);
        before = segment;
    }
}

/* Add an area with this outline, or a line along it if the width is not 0. */
void add_path(const Box *box, Path path, bool is_closed, double width, int64_t cap) {
    if (width > 0.0)
        add_stroke(box, path, is_closed, width, cap);
    else
        add_outline(box, path);
}

/* Add the k segments (k, 4, 2), curved (k,), of an outline, or of a line if its width is not 0, to
the sums (height, width + 2) of a box with the upper left corner (left, top). */
API void cover_pixels(int64_t height, int64_t width, double left, double top, double *sums,
    int64_t count, const double (*segments)[4][2], const bool *curved, int64_t is_closed,
    double line_width, int64_t cap) {
    const Box box = {sums, height, width, at(left, top)};
    add_path(&box, (Path){segments, curved, count}, is_closed, line_width, cap);
}
