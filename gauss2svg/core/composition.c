/* Layers over each other, and the moves of their outlines by steps of Gauss-Newton.

The parameters are the coordinates of all points, x and y in turns, and then the widths of layers.
A sample is a piece of an outline in one pixel. It has nine derivatives: by the coordinates of the
four control points of its segment, and by the width of its layer. c counts channels. */

#include "paints.h"
#include "paths.h"

enum { ACROSS = 6, DERIVATIVES = 9 }; /* ACROSS: places along the end of a stroke */

/* Draw l layers over `canvas` (h, w, c), and keep their coverage and what lies below them.

segment, curved  (k, 4, 2) and (k,) of all paths
path_start   (p + 1,) first segment of each path; closed (p,)
layer_start  (l + 1,) first path of each layer; width, cap (l,), the width in px, 0 for areas
opacity, form, place, table  (l,), (l,), (l, 4) and (l, SHADES, c) paints of the layers. Colours of
             transparent layers are multiplied by their opacity
box, offset  (l, 4) left, top, width and height of a layer in px, and (l,) where its pixels are in
             `cover` (m,) and `below` (m, c)
sums         buffer for (height, width + 2) of the largest box */
API void compose_layers(int64_t l, int64_t w, int64_t c, const double (*segment)[4][2],
    const bool *curved, const int64_t *path_start, const bool *closed, const int64_t *layer_start,
    const double *width, const int64_t *cap, const double *opacity, const int64_t *form,
    const double (*place)[4], const float *table, const int64_t (*box)[4], const int64_t *offset,
    double *sums, float *canvas, float *cover, float *below) {
    for (int64_t k = 0; k < l; k++) {
        const int64_t x0 = box[k][0], y0 = box[k][1], across = box[k][2], down = box[k][3];
        const Box part = {sums, down, across, at((double)x0, (double)y0)};
        memset(sums, 0, (size_t)(down * (across + 2)) * sizeof *sums);
        for (int64_t p = layer_start[k]; p < layer_start[k + 1]; p++) {
            const int64_t s = path_start[p];
            const Path path = {segment + s, curved + s, path_start[p + 1] - s};
            add_path(&part, path, closed[p], width[k], cap[k]);
        }
        float *own_cover = cover + offset[k], *own_below = below + c * offset[k];
        for (int64_t y = 0; y < down; y++) {
            float *pixel = canvas + ((y0 + y) * w + x0) * c;
            double winding = 0.0;
            for (int64_t x = 0; x < across; x++, pixel += c, own_below += c) {
                winding += sums[y * (across + 2) + x];
                const double share = min(fabs(winding), 1.0);
                *own_cover++ = (float)share;
                memcpy(own_below, pixel, (size_t)c * sizeof *pixel);
                if (share == 0.0)
                    continue;
                const float *color = shade(form[k], place[k], table + k * SHADES * c, c,
                    (double)(x0 + x) + 0.5, (double)(y0 + y) + 0.5);
                for (int64_t i = 0; i < c; i++)
                    pixel[i] = (float)(pixel[i] + share * (color[i] - opacity[k] * pixel[i]));
            }
        }
    }
}

/* Turn `cover` into what shows of layers, and `below` into derivatives of pixels by coverage.

above  (h, w) ones. Changed to the share of each pixel that no layer hides. The other arguments are
       as in compose_layers. */
API void weigh_layers(int64_t l, int64_t w, int64_t c, const double *opacity, const int64_t *form,
    const double (*place)[4], const float *table, const int64_t (*box)[4], const int64_t *offset,
    float *cover, float *below, float *above) {
    for (int64_t k = l - 1; k >= 0; k--) {
        float *own_cover = cover + offset[k], *own_below = below + c * offset[k];
        for (int64_t y = box[k][1]; y < box[k][1] + box[k][3]; y++) {
            for (int64_t x = box[k][0]; x < box[k][0] + box[k][2]; x++, own_below += c) {
                const float *color = shade(
                    form[k], place[k], table + k * SHADES * c, c, (double)x + 0.5, (double)y + 0.5);
                const double shows = above[y * w + x];
                for (int64_t i = 0; i < c; i++)
                    own_below[i] = (float)((color[i] - opacity[k] * own_below[i]) * shows);
                above[y * w + x] = (float)(shows * (1.0 - opacity[k] * *own_cover));
                *own_cover *= (float)shows;
                own_cover++;
            }
        }
    }
}

/* List what a move of outlines changes, one sample for each pixel that a segment runs through, and
return the number of samples.

count    (k,) number of places along each segment (4, 2) at which it is sampled
is_first, is_last  (k,) whether a segment begins or ends an open path
layer_of  (k,) layer of each segment
sign     (l,) 1 or -1 for the side of its outlines on which a layer lies
width    (l,) width of its strokes in px, 0 for areas
box, offset, weight  (l, 4), (l,) and (m, c) of the layers, as weigh_layers writes them
pixel, owner  (n,) outputs: pixel y * w + x, and segment
jacobian (n, 9) output: derivatives of the pixel's coverage
weights  (n, c) output: derivative of the pixel by its coverage */
API int64_t list_samples(int64_t k, int64_t w, int64_t c, const double (*segment)[4][2],
    const bool *curved, const int64_t *count, const bool *is_first, const bool *is_last,
    const int64_t *layer_of, const double *sign, const double *width, const int64_t (*box)[4],
    const int64_t *offset, const float *weight, int64_t *pixel, int64_t *owner,
    double (*jacobian)[DERIVATIVES], double *weights) {
    int64_t n = 0;
    for (int64_t s = 0; s < k; s++) {
        const int64_t layer = layer_of[s], *b = box[layer];
        const bool is_stroke = width[layer] > 0.0;
        /* An area has one side. A stroke has two sides and, if it is open, two ends. */
        for (int side = 0; side < (is_stroke ? 4 : 1); side++) {
            if ((side == 2 && !is_first[s]) || (side == 3 && !is_last[s]))
                continue;
            const double steps = side >= 2 ? ACROSS : (double)count[s];
            int64_t before = -1;
            for (double i = 0.5; i < steps; i++) {
                const double t = side < 2 ? i / steps : side - 2.0, u = 1.0 - t;
                const double way = side >= 2   ? 2.0 * side - 5.0
                                   : is_stroke ? 1.0 - 2.0 * side
                                               : sign[layer];
                point along;
                const point on = point_at((Segment){segment[s], curved[s]}, t, &along);
                const double speed = length(along) + 1e-12;
                const double beside = width[layer] * (side < 2 ? 0.5 * way : i / steps - 0.5);
                const point normal = side < 2 ? -way / steps * turned(along)
                                              : way * width[layer] / steps / speed * along;
                const point place = on - beside / speed * turned(along);
                const int64_t x = (int64_t)floor(place[0]) - b[0],
                              y = (int64_t)floor(place[1]) - b[1];
                if (x < 0 || x >= b[2] || y < 0 || y >= b[3]) {
                    before = -1;
                    continue;
                }
                const int64_t here = (b[1] + y) * w + b[0] + x;
                if (here != before) {
                    pixel[n] = before = here;
                    owner[n] = s;
                    memset(jacobian[n], 0, sizeof *jacobian);
                    for (int64_t j = 0; j < c; j++)
                        weights[n * c + j] = weight[(offset[layer] + y * b[2] + x) * c + j];
                    n++;
                }
                const double basis[4] = {curved[s] ? u * u * u : u,
                    curved[s] ? 3.0 * u * u * t : 0.0, curved[s] ? 3.0 * u * t * t : 0.0,
                    curved[s] ? t * t * t : t};
                for (int j = 0; j < 8; j++)
                    jacobian[n - 1][j] += basis[j / 2] * normal[j % 2];
                if (is_stroke && side < 2)
                    jacobian[n - 1][8] += 0.5 * speed / steps;
            }
        }
    }
    return n;
}

/* Write the image (m, c) of a move `p` (u,) of the parameters, if `p` is not NULL, and replace the
tied ones in `p`. Then write the gradient (u,) of the image by the parameters to `result`. The
gradient by a tied parameter becomes a part of those by its node and its master.

place, owner  (n,) row of each sample's pixel in `image`, and its segment
jacobian, weights  (n, 9) and (n, c) as list_samples writes them
column   (k, 9) parameters by which the derivatives of a segment's samples are
ties     (3, t) parameter, node and master, and factors (2, t): a parameter is the sum of the node
         and the master, times these */
API void project_samples(int64_t n, int64_t c, int64_t m, int64_t u, int64_t t,
    const int64_t *place, const int64_t *owner, const double (*jacobian)[DERIVATIVES],
    const double *weights, const int64_t (*column)[DERIVATIVES], const int64_t *ties,
    const double *factors, double *p, double *image, double *result) {
    const int64_t *tied = ties, *node = ties + t, *master = ties + 2 * t;
    if (p != NULL) {
        for (int64_t i = 0; i < t; i++)
            p[tied[i]] = factors[i] * p[node[i]] + factors[t + i] * p[master[i]];
        memset(image, 0, (size_t)(m * c) * sizeof *image);
        for (int64_t s = 0; s < n; s++) {
            double by = 0.0;
            for (int j = 0; j < DERIVATIVES; j++)
                by += jacobian[s][j] * p[column[owner[s]][j]];
            for (int64_t i = 0; i < c; i++)
                image[place[s] * c + i] += by * weights[s * c + i];
        }
    }
    memset(result, 0, (size_t)u * sizeof *result);
    for (int64_t s = 0; s < n; s++) {
        double g = 0.0;
        for (int64_t i = 0; i < c; i++)
            g += image[place[s] * c + i] * weights[s * c + i];
        for (int j = 0; j < DERIVATIVES; j++)
            result[column[owner[s]][j]] += g * jacobian[s][j];
    }
    for (int64_t i = 0; i < t; i++) {
        const double g = result[tied[i]];
        result[tied[i]] = 0.0;
        result[node[i]] += factors[i] * g;
        result[master[i]] += factors[t + i] * g;
    }
}
