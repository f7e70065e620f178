/* The walk over tiles: blending, its gradients, and the cost of removing a Gaussian.

gaussians_float.c and gaussians_double.c include this file, which computes in REAL. Each pixel is
blended from front to back. With T_k the transmittance in front of Gaussian k,

    alpha_k = opacity_k f(r_k),  w_k = alpha_k T_k,  C = sum w_k c_k + T_end background,
    T_{k+1} = T_k - w_k.

The forward pass leaves alpha_k and T_k in the buffers. The backward pass walks from back to front
and does not divide by 1 - alpha. With g the gradient by the pixel, and B_k the colour of everything
that is behind k,

    dL/dalpha_k = T_k (g.c_k - g.B_k),  B_{k-1} = B_k + alpha_k (c_k - B_k).

Shapes are evaluated in whitened coordinates z = W (x - mean) with r^2 = |z|^2, so that rounding
cannot make a squared term negative for thin Gaussians. z1 depends only on the column, and z2 takes
one addition for each row. The gradients of all parameters follow from ten numbers for each pair.
Five of these are moments of h = dL/dalpha alpha', where alpha' = alpha + opacity rim / (1 - rim)
inside the support, so that dL/dr^2 = -h / 2:

    sum h z1, sum h z2, sum h z1^2, sum h z1 z2, sum h z2^2,
    sum dL/dalpha alpha, sum w g (3), sum dL/dalpha alpha' t ln s.

The last is the negative of dL/dbeta. If the exponent beta of a shape is not 1, the falloff has
t = s^beta in place of s = r^2 / 2, and h is multiplied by beta t / s = beta s^(beta - 1).

A plain ellipse has no falloff but covers a share of each pixel (gauss2svg.scene.falloff). If it is
wider than a pixel, alpha = opacity clip(1/2 + (R - r) / g) with g = n / r and n = |W^T z|. The
gradient takes g as constant, so h = dL/dalpha opacity / n for pixels on the rim, else 0.

Additive blending is C = background + sum a_k c_k with a_k = f(r_k). Colours are signed, and the
order of the shapes does not matter. So dL/da_k = g.c_k and dL/dc_k = sum a_k g. */

#include "lanes.h"

enum { ROWS = 16, PLANE = ROWS * LANES, MOMENTS = 10 };
enum { RENDER, SQUARED_ERROR, GIVEN_GRADIENT, REMOVAL }; /* modes of walk_tiles */

/* exp(-r^2 / 2) at the cut r = 3 as exp_of_half gives it, and slightly more than its rounding
errors, so that alpha is exactly 0 from the cut on. Powers s^beta at the cut have larger errors. */
static const double RIM = IS_DOUBLE ? 0.011108996538242348 : 0.011108799596299273;
static const double POWER_RIM = IS_DOUBLE ? 0.011108996538252307 : 0.011110996538242306;
static const REAL LEAST_HALF_SQUARE = 1e-12f; /* ln s is that of this number if s is smaller */
static const REAL LEAST_SQUARE =
    IS_DOUBLE ? 1e-60 : 1e-20f; /* so that r / n is finite at the mean */
static const REAL HUGE_REAL = 1e30f;

/* A tile with the first pixel (x0, y0), whose pairs are order[first:end] from front to back, and
the Gaussians of the canvas.

shape      (n, 11) mean x, y in px, whitening w11, w21, w22, beta, R^2, o11, o21, o22, max_share. R
           is the radius of the cut, or of the rim of a plain ellipse. The last four are 0 but for
           plain ellipses (gauss2svg.render.cpu.Splats)
paint      (n, 4) opacity, r, g, b
gaussian, rows  (p,) the Gaussian of each pair, and (p, 2) its first image row, and the row after
           its last one
alpha, front, steep, logs  what the passes keep of each row of each pair, in the order of blending,
           16 numbers a row: alpha, transmittance in front of it (not of additive shapes),
           s^(beta - 1) or the slope of `covered` (not of plain Gaussians), and ln s (of shapes with
           a beta only) */
typedef struct {
    const double (*shape)[11], (*paint)[4];
    const int32_t *gaussian, (*rows)[2], *order;
    int64_t first, end;
    int x0, y0;
    REAL *alpha, *front, *steep, *logs;
} Tile;

/* A pair as the passes need it. z1 and z2 belong to the row `first` of the tile, and z2 grows by
`step` from each row to the next. */
typedef struct {
    const double *shape, *color;
    bool is_plain, has_power;
    int first, end;
    double opacity, rim;
    lanes z1, z2, step;
} Pair;

/* Return pair p of a tile. `rim` is exp(-s^beta) at the cut.

z1 and z2 are computed in double and then rounded, because float is too coarse for offsets from a
distant mean and for offsets within a shape of sigma 1e-6 px. Moreover, z2 of a thin sheared shape
is the sum of two terms that nearly cancel. */
INLINE Pair pair_of(Tile tile, int32_t p, bool additive) {
    static const doubles columns = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
    const double *s = tile.shape[tile.gaussian[p]], *paint = tile.paint[tile.gaussian[p]];
    const int32_t *rows = tile.rows[p];
    const bool has_power = !additive && s[7] == 0.0 && s[5] != 1.0;
    const doubles u = columns + (tile.x0 + 0.5 - s[0]);
    const doubles z2 = s[3] * u + s[4] * (rows[0] + 0.5 - s[1]);
    return (Pair){
        .shape = s,
        .color = paint + 1,
        .is_plain = !additive && s[7] != 0.0,
        .has_power = has_power,
        .first = rows[0] - tile.y0,
        .end = rows[1] - tile.y0,
        .opacity = additive ? 1.0 : paint[0],
        .step = splat(s[4]),
        .rim = has_power ? POWER_RIM : RIM,
        .z1 = __builtin_convertvector(s[2] * u, lanes),
        .z2 = __builtin_convertvector(z2, lanes),
    };
}

/* Return how much of each pixel a plain ellipse covers, and write the slope of this share.

The slope is the derivative of the share by r, times -1 / r. It is 1 / n for pixels on the near rim,
-1 / n for pixels on the far rim, and else 0. Minima and maxima with a huge factor stand for
comparisons, because they need no branch. */
INLINE lanes covered(const Pair *pair, lanes z2, lanes *slope) {
    const double *s = pair->shape;
    const lanes z1 = pair->z1, zero = {0}, one = splat(1.0), radius = splat(sqrt(s[6]));
    const lanes o1 = (REAL)s[7] * z1, o2 = (REAL)s[8] * z1 + (REAL)s[9] * z2;
    const lanes inside = smaller(one, larger(zero, one - (o1 * o1 + o2 * o2)) * HUGE_REAL);
    const lanes n1 = (REAL)s[2] * z1 + (REAL)s[3] * z2, n2 = (REAL)s[4] * z2;
    const lanes r = roots(z1 * z1 + z2 * z2 + LEAST_SQUARE);
    const lanes inverse_n = one / roots(n1 * n1 + n2 * n2 + LEAST_SQUARE), px = r * inverse_n;
    const lanes near = larger(zero, (REAL)0.5 + (radius - r) * px);
    const lanes far = (REAL)0.5 + (radius + r) * px;
    const lanes on_near_rim =
        smaller(one, near * HUGE_REAL) * smaller(one, larger(zero, one - near) * HUGE_REAL);
    const lanes on_far_rim = smaller(one, larger(zero, one - far) * HUGE_REAL);
    const lanes share = smaller(one, near) + smaller(one, far) - one;
    *slope = inside * ((on_near_rim - on_far_rim) * inverse_n);
    return inside * smaller(splat(s[10]), larger(zero, share));
}

/* Blend the pairs of a tile from front to back, and return how many numbers of each buffer are
filled.

inside     1 for columns of the image, else 0
color      (3, 16, 16) output: sum of w c
remaining  (16, 16) output: transmittance behind all pairs, and 1 for additive blending */
INLINE int64_t compose(
    Tile tile, bool additive, lanes inside, REAL *color, REAL *remaining) {
    int64_t filled = 0;
    for (int j = 0; j < 3 * PLANE; j += LANES)
        store(color + j, splat(0.0));
    for (int j = 0; j < PLANE; j += LANES)
        store(remaining + j, additive ? splat(1.0) : inside);
    for (int64_t k = tile.first; k < tile.end; k++) {
        const Pair pair = pair_of(tile, tile.order[k], additive);
        const double peak = pair.opacity / (1.0 - pair.rim);
        const lanes height = splat(peak), foot = splat(pair.rim * peak);
        const lanes c0 = splat(pair.color[0]), c1 = splat(pair.color[1]), c2 = splat(pair.color[2]);
        const lanes squares = pair.z1 * pair.z1, reach = splat(pair.shape[6]), zero = {0};
        const REAL power = (REAL)((pair.shape[5] - 1.0) * 1.4426950408889634);
        lanes z2 = pair.z2, alpha;
        for (int y = pair.first; y < pair.end; y++, z2 += pair.step, filled += LANES) {
            if (pair.is_plain) {
                lanes slope;
                alpha = (REAL)pair.opacity * covered(&pair, z2, &slope);
                store(tile.steep + filled, slope);
            } else {
                lanes q = smaller(z2 * z2 + squares, reach);
                if (pair.has_power) {
                    const lanes ln = logarithms(larger(q * (REAL)0.5, splat(LEAST_HALF_SQUARE)));
                    const lanes steep = powers_of_two(ln * power);
                    store(tile.steep + filled, steep);
                    store(tile.logs + filled, ln);
                    q = steep * q;
                }
                alpha = larger(height * exp_of_half(q) - foot, zero);
            }
            lanes w = alpha;
            REAL *left = remaining + y * LANES, *sum = color + y * LANES;
            if (additive) {
                w = alpha = alpha * inside;
            } else {
                const lanes front = load(left);
                store(tile.front + filled, front);
                w = alpha * front;
                store(left, front - w);
            }
            store(tile.alpha + filled, alpha);
            store(sum, load(sum) + w * c0);
            store(sum + PLANE, load(sum + PLANE) + w * c1);
            store(sum + 2 * PLANE, load(sum + 2 * PLANE) + w * c2);
        }
    }
    return filled;
}

/* Write the moments (p, 10) of each pair of a blended tile.

filled  result of `compose`, whose other arguments have the same names
g       (3, 16, 16) dL/dpixel, which is 0 outside the image
behind  (16, 16) g.background on entry. It is overwritten */
INLINE void backpropagate(Tile tile, bool additive, int64_t filled, const REAL *g,
    REAL *behind, REAL (*moments)[MOMENTS]) {
    for (int64_t k = tile.end - 1; k >= tile.first; k--) {
        const Pair pair = pair_of(tile, tile.order[k], additive);
        const double share = pair.is_plain ? 1.0 : pair.rim / (1.0 - pair.rim);
        const lanes foot = splat(share * pair.opacity);
        const lanes c0 = splat(pair.color[0]), c1 = splat(pair.color[1]), c2 = splat(pair.color[2]);
        const lanes z1 = pair.z1, reach = splat(pair.shape[6]);
        lanes s0 = {0}, s1 = {0}, s2 = {0}, sum_alpha = {0};
        lanes sum_h = {0}, sum_hz = {0}, sum_hzz = {0}, sum_beta = {0};
        filled -= (int64_t)(pair.end - pair.first) * LANES;
        int64_t row = filled;
        lanes z2 = pair.z2;
        for (int y = pair.first; y < pair.end; y++, z2 += pair.step, row += LANES) {
            const lanes alpha = load(tile.alpha + row);
            const REAL *by_pixel = g + y * LANES;
            const lanes g0 = load(by_pixel), g1 = load(by_pixel + PLANE);
            const lanes g2 = load(by_pixel + 2 * PLANE);
            lanes d = g0 * c0 + g1 * c1 + g2 * c2, w = alpha, wd, h;
            /* `rest` is `foot` where alpha > 0, else 0. A minimum needs no branch. */
            const lanes rest = smaller(foot, alpha * HUGE_REAL);
            if (additive) {
                wd = alpha * d;
                h = (alpha + rest) * d;
            } else {
                const lanes front = load(tile.front + row), b = load(behind + y * LANES);
                d -= b;
                store(behind + y * LANES, b + alpha * d);
                w = alpha * front;
                wd = w * d;
                h = wd + rest * (front * d);
                if (pair.is_plain)
                    h = (h - wd) * load(tile.steep + row);
                if (pair.has_power) {
                    h *= load(tile.steep + row);
                    const lanes q = smaller(z2 * z2 + z1 * z1, reach);
                    sum_beta += h * (q * load(tile.logs + row));
                }
            }
            s0 += w * g0;
            s1 += w * g1;
            s2 += w * g2;
            sum_alpha += wd;
            sum_h += h;
            sum_hz += h * z2;
            sum_hzz += h * z2 * z2;
        }
        const REAL beta = pair.has_power ? (REAL)pair.shape[5] : (REAL)1;
        sum_h *= beta;
        sum_hz *= beta;
        const lanes sums[MOMENTS] = {sum_h * z1, sum_hz, sum_h * z1 * z1, sum_hz * z1, sum_hzz * beta,
            sum_alpha, s0, s1, s2, (REAL)0.5 * sum_beta};
        const lanes sum = totals(sums, MOMENTS);
        memcpy(moments[tile.order[k]], &sum, sizeof *moments);
    }
}

/* Write for each pair (p, 2) the change of the weighted squared error without its Gaussian, and the
sum of weight w_k^2.

Without Gaussian k, a pixel changes by d = w_k (B_k - c_k), or with additive blending by
d = -a_k c_k. So its weighted squared error changes by weight d.(d + 2 error).

error   (3, 16, 16) rendered - target, which is 0 outside the image
weight  (16, 16) weights of the pixels, which are 0 outside the image
behind  (3, 16, 16) the background on entry. It is overwritten */
INLINE void remove_each(Tile tile, bool additive, int64_t filled, const REAL *error,
    const REAL *weight, REAL *behind, REAL (*cost)[2]) {
    for (int64_t k = tile.end - 1; k >= tile.first; k--) {
        const int32_t p = tile.order[k], *rows = tile.rows[p];
        const double *color = tile.paint[tile.gaussian[p]] + 1;
        lanes change = {0}, mass = {0};
        filled -= (int64_t)(rows[1] - rows[0]) * LANES;
        int64_t row = filled;
        for (int y = rows[0] - tile.y0; y < rows[1] - tile.y0; y++, row += LANES) {
            const lanes alpha = load(tile.alpha + row), by = load(weight + y * LANES);
            const lanes w = additive ? alpha : alpha * load(tile.front + row);
            mass += by * (w * w);
            for (int c = 0; c < 3; c++) {
                const int64_t j = c * PLANE + y * LANES;
                lanes difference = splat(-color[c]);
                if (!additive) {
                    const lanes b = load(behind + j);
                    difference += b;
                    store(behind + j, b - alpha * difference);
                }
                const lanes d = w * difference, e = load(error + j);
                change += by * (d * (d + e + e));
            }
        }
        const lanes sums = totals((lanes[]){change, mass}, 2);
        memcpy(cost[p], &sums, sizeof cost[p]);
    }
}

/* Return the first w numbers, and 0 for the other lanes. */
INLINE lanes load_part(const REAL *from, int w) {
    lanes v = {0};
    if (w == LANES)
        return load(from);
    memcpy(&v, from, (size_t)w * sizeof(REAL));
    return v;
}

/* Write the first w numbers. */
INLINE void store_part(REAL *to, lanes v, int w) {
    if (w == LANES)
        store(to, v);
    else
        memcpy(to, &v, (size_t)w * sizeof(REAL));
}

/* Do the work of a mode for the tiles first_tile..end_tile of an image of height x width px.

mode        RENDER computes the image. SQUARED_ERROR computes the image and the moments of the
            gradient of 1/2 sum weight (rendered - target)^2. GIVEN_GRADIENT computes only the
            moments of a gradient, which is passed as `image`. REMOVAL computes the image and what
            `remove_each` writes
background  (3,) colour below all Gaussians; ground (3, h, w) replaces it if it is not NULL
image       (3, h, w) target or gradient; weight (h, w) is read for SQUARED_ERROR and REMOVAL
start, order  (tiles + 1,) and (p,): tile t has the pairs order[start[t]:start[t + 1]], front first
buffers     4 capacity + 16 numbers. The capacity is 16 for each pair row of the fullest tile
pair_out    (p, 10) moments or (p, 2) costs: output
out, loss   (3, h, w) and (tiles,) outputs: the image, and the squared error of each tile */
API void SUFFIXED(walk_tiles)(int64_t additive, int64_t mode, int64_t first_tile, int64_t end_tile,
    int64_t height, int64_t width, const double (*shape)[11], const double (*paint)[4],
    const REAL *background, const REAL *ground, const REAL *image, const REAL *weight,
    const int32_t *gaussian, const int32_t (*rows)[2], const int64_t *start, const int32_t *order,
    REAL *buffers, int64_t capacity, REAL *pair_out, REAL *out, double *loss) {
    buffers += (64 - (uintptr_t)buffers % 64) / sizeof(REAL); /* a row is one line of the cache */
    const int64_t tile_columns = (width + LANES - 1) / LANES;
    _Alignas(64) REAL color[3 * PLANE], below[3 * PLANE], behind[3 * PLANE], gradient[3 * PLANE];
    _Alignas(64) REAL remaining[PLANE], weights[PLANE];
    memset(gradient, 0, sizeof gradient);
    for (int j = 0; j < 3 * PLANE; j++)
        below[j] = background[j / PLANE];
    for (int64_t t = first_tile; t < end_tile; t++) {
        const int x0 = (int)(t % tile_columns) * LANES, y0 = (int)(t / tile_columns) * ROWS;
        const int h = (int)least(ROWS, height - y0), w = (int)least(LANES, width - x0);
        lanes inside, squares = {0};
        for (int x = 0; x < LANES; x++)
            inside[x] = x < w;
        for (int j = 0; j < 3 * h && ground != NULL; j++)
            store(below + j / h * PLANE + j % h * LANES,
                load_part(ground + (j / h * height + y0 + j % h) * width + x0, w));
        const Tile tile = {shape, paint, gaussian, rows, order, start[t], start[t + 1], x0, y0,
            buffers, buffers + capacity, buffers + 2 * capacity, buffers + 3 * capacity};
        const int64_t filled = additive ? compose(tile, true, inside, color, remaining)
                                        : compose(tile, false, inside, color, remaining);
        for (int c = 0; c < 3; c++) {
            for (int y = 0; y < ROWS; y++) {
                const int64_t j = c * PLANE + y * LANES, pixel = (y0 + y) * width + x0;
                const int64_t value_at = c * height * width + pixel;
                if (y >= h) {
                    store(gradient + j, splat(0.0));
                } else if (mode == GIVEN_GRADIENT) {
                    store(gradient + j, load_part(image + value_at, w));
                } else {
                    const lanes value =
                        load(color + j) + load(remaining + y * LANES) * load(below + j);
                    store_part(out + value_at, value, w);
                    if (mode == RENDER)
                        continue;
                    lanes error = (value - load_part(image + value_at, w)) * inside;
                    squares += error * error;
                    if (mode == SQUARED_ERROR)
                        error *= load_part(weight + pixel, w);
                    store(gradient + j, error);
                }
            }
        }
        loss[t] = totals(&squares, 1)[0];
        if (mode == SQUARED_ERROR || mode == GIVEN_GRADIENT) {
            for (int j = 0; j < PLANE; j += LANES)
                store(behind + j, load(gradient + j) * load(below + j) +
                                      load(gradient + j + PLANE) * load(below + j + PLANE) +
                                      load(gradient + j + 2 * PLANE) * load(below + j + 2 * PLANE));
            if (additive)
                backpropagate(tile, true, filled, gradient, behind, (REAL(*)[MOMENTS])pair_out);
            else
                backpropagate(tile, false, filled, gradient, behind, (REAL(*)[MOMENTS])pair_out);
        } else if (mode == REMOVAL) {
            memcpy(behind, below, sizeof behind);
            for (int y = 0; y < ROWS; y++)
                store(weights + y * LANES,
                    y < h ? load_part(weight + (y0 + y) * width + x0, w) : splat(0.0));
            remove_each(tile, additive, filled, gradient, weights, behind, (REAL(*)[2])pair_out);
        }
    }
}

/* Add up the values (p, m) of the pairs offset[i]:offset[i + 1] of the Gaussians first..end.

offset  (n + 1,); totals (n, m) output */
API void SUFFIXED(add_pairs)(int64_t first, int64_t end, int64_t m, const int64_t *offset,
    const REAL *values, double *totals) {
    for (int64_t i = first; i < end; i++) {
        for (int64_t k = 0; k < m; k++)
            totals[i * m + k] = 0.0;
        for (int64_t p = offset[i]; p < offset[i + 1]; p++)
            for (int64_t k = 0; k < m; k++)
                totals[i * m + k] += values[p * m + k];
    }
}
