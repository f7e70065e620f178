/* Regions of a picture: growth of labels from seeds, and mixtures of their colours. */

#include "paints.h"

enum { NEAR = 1, FAR = 2 };                 /* px within which the colours of a mixture lie */
enum { MOST_NEAR = 12, MOST_CHANNELS = 8 }; /* labels around a pixel that are tried; channels */
static const double ENOUGH = 0.0006; /* squared error at which colours farther away are not tried */
/* A mixture of three colours must lower the squared error by this, and one of two by less, because
three colours can make nearly every other. */
static const double PRICE_OF_TWO = 2e-5, PRICE_OF_THREE = 1.5e-4;
static const double LEAST_CONTRAST = 1e-5; /* squared distance below which colours do not mix */

/* A pixel, the neighbour from which it is reached, and its key. */
typedef struct {
    double key;
    int32_t pixel, from;
} Reached;

/* Add an entry to a binary heap, whose smallest key comes first, and return the new count. */
static int64_t push(Reached *heap, int64_t count, Reached added) {
    int64_t i = count;
    for (; i > 0 && heap[(i - 1) / 2].key > added.key; i = (i - 1) / 2)
        heap[i] = heap[(i - 1) / 2];
    heap[i] = added;
    return count + 1;
}

/* Remove the entry with the smallest key, which has been read, and return the new count. */
static int64_t pop(Reached *heap, int64_t count) {
    const Reached last = heap[--count];
    int64_t i = 0;
    for (int64_t child = 1; child < count; child = 2 * i + 1) {
        child += child + 1 < count && heap[child + 1].key < heap[child].key;
        if (heap[child].key >= last.key)
            break;
        heap[i] = heap[child];
        i = child;
    }
    heap[i] = last;
    return count;
}

/* Give each pixel without a label that of a neighbour, the nearest colours first. A pixel is
compared with the pixel of a core from which its neighbour got its label. The key of a neighbour is
the squared difference of both, but at least half of the key of the pixel beside it.

pixels  (h, w, c); labels (h, w), -1 for none. They are replaced
origin  (h, w) index of each pixel. It is changed to that of the pixel of a core from which a pixel
        got its label
heap    (n, 2) buffer with four entries for each pixel without a label */
API void grow_labels(int64_t h, int64_t w, int64_t c, const float *pixels, int32_t *labels,
    int32_t *origin, double *heap_of_doubles) {
    Reached *heap = (Reached *)heap_of_doubles;
    int64_t count = 0;
    for (int64_t seed = 0; seed < h * w || count > 0; seed++) {
        /* First come the pixels of all cores, then those that are taken from the heap. */
        int64_t pixel = seed;
        double least_key = 0.0;
        if (seed >= h * w) {
            const Reached first = heap[0];
            count = pop(heap, count);
            pixel = first.pixel;
            if (labels[pixel] >= 0)
                continue;
            labels[pixel] = labels[first.from];
            origin[pixel] = origin[first.from];
            least_key = 0.5 * first.key;
        } else if (labels[pixel] < 0) {
            continue;
        }
        for (int side = 0; side < 4; side++) {
            const int64_t v = pixel / w + (side == 0) - (side == 1);
            const int64_t u = pixel % w + (side == 2) - (side == 3);
            if (v < 0 || v >= h || u < 0 || u >= w || labels[v * w + u] >= 0)
                continue;
            double key = 0.0;
            for (int64_t i = 0; i < c; i++)
                key += square(pixels[(v * w + u) * c + i] - pixels[origin[pixel] * c + i]);
            const int32_t other = (int32_t)(v * w + u), from = (int32_t)pixel;
            count = push(heap, count, (Reached){max(key, least_key), other, from});
        }
    }
}

/* A mixture of at most three colours: their labels, -1 for none, their shares, and the squared
distance of a pixel from it. */
typedef struct {
    int32_t label[3];
    double share[3], error;
} Mixture;

/* Replace a mixture by that of colours with these indices and shares if this is better, though its
error rises by `price`. An index of -1 is no colour. */
static void try_mixture(Mixture *best, const float *pixel, int64_t c,
    double (*color)[MOST_CHANNELS], const int64_t *names, const int index[3], const double share[3],
    double price) {
    double error = price;
    for (int64_t i = 0; i < c; i++) {
        double mixed = 0.0;
        for (int k = 0; k < 3 && index[k] >= 0; k++)
            mixed += share[k] * color[index[k]][i];
        error += square(pixel[i] - mixed);
    }
    if (error >= best->error)
        return;
    best->error = error;
    for (int k = 0; k < 3; k++) {
        best->label[k] = index[k] < 0 ? -1 : (int32_t)names[index[k]];
        best->share[k] = index[k] < 0 ? 0.0 : share[k];
    }
}

/* Return the dot product of the differences of two colours (c,) from a third. */
static double dot_from(const double *a, const double *b, const double *third, int64_t c) {
    double sum = 0.0;
    for (int64_t i = 0; i < c; i++)
        sum += (a[i] - third[i]) * (b[i] - third[i]);
    return sum;
}

/* Return the best mixture of at most three of `count` colours, whose labels are `names`. */
static Mixture best_mixture(const float *pixel, int64_t c, double (*color)[MOST_CHANNELS],
    const int64_t *names, int count) {
    Mixture best = {{-1, -1, -1}, {0.0, 0.0, 0.0}, 1e9};
    double p[MOST_CHANNELS];
    for (int64_t i = 0; i < c; i++)
        p[i] = pixel[i];
    for (int i = 0; i < count; i++)
        try_mixture(&best, pixel, c, color, names, (int[3]){i, -1, -1}, (double[3]){1.0}, 0.0);
    for (int i = 0; i < count; i++) {
        for (int j = i + 1; j < count; j++) {
            const double length2 = dot_from(color[i], color[i], color[j], c);
            const double s = clip(dot_from(p, color[i], color[j], c) / length2, 0.0, 1.0);
            if (length2 >= LEAST_CONTRAST)
                try_mixture(&best, pixel, c, color, names, (int[3]){i, j, -1},
                    (double[3]){s, 1.0 - s}, PRICE_OF_TWO);
        }
    }
    if (best.error < 2.0 * PRICE_OF_THREE)
        return best;
    for (int i = 0; i < count; i++) {
        for (int j = i + 1; j < count; j++) {
            for (int k = j + 1; k < count; k++) {
                const double *a = color[i], *b = color[j], *third = color[k];
                const double aa = dot_from(a, a, third, c), ab = dot_from(a, b, third, c);
                const double bb = dot_from(b, b, third, c), ap = dot_from(a, p, third, c);
                const double bp = dot_from(b, p, third, c), det = aa * bb - ab * ab;
                double s = (bb * ap - ab * bp) / det, t = (aa * bp - ab * ap) / det;
                if (!(det >= LEAST_CONTRAST) || min(s, min(t, 1.0 - s - t)) < -0.05)
                    continue;
                s = max(s, 0.0);
                t = max(t, 0.0);
                const double all = s + t + max(1.0 - s - t, 0.0), r = max(1.0 - (s + t) / all, 0.0);
                try_mixture(&best, pixel, c, color, names, (int[3]){i, j, k},
                    (double[3]){s / all, t / all, r}, PRICE_OF_THREE);
            }
        }
    }
    return best;
}

/* Explain pixels as mixtures of the colours of the labels around them.

pixels, labels  (h, w, c) and (h, w), -1 for none
form, place, table  (k,), (k, 4) and (k, SHADES, c) paints of the labels
n, ys, xs  number of pixels, and (n,) their rows and columns
extra      (c,) one more colour, whose label is `extra_name`, or -1 to leave it out. With it, labels
           within FAR are tried. Else those within NEAR are tried first
label, share, error  (n, 3), (n, 3) and (n,) outputs */
API void explain_pixels(int64_t h, int64_t w, int64_t c, const float *pixels, const int32_t *labels,
    const int64_t *form, const double (*place)[4], const float *table, int64_t n, const int64_t *ys,
    const int64_t *xs, const double *extra, int64_t extra_name, int32_t (*label)[3],
    float (*share)[3], float *error) {
    double color[MOST_NEAR + 1][MOST_CHANNELS];
    int64_t names[MOST_NEAR + 1];
    for (int64_t m = 0; m < n; m++) {
        const int64_t y = ys[m], x = xs[m];
        Mixture best = {.error = INFINITY};
        for (int64_t radius = extra_name < 0 ? NEAR : FAR; radius <= FAR && best.error >= ENOUGH;
            radius++) {
            int count = 0;
            for (int64_t v = most(0, y - radius); v < least(h, y + radius + 1); v++) {
                for (int64_t u = most(0, x - radius); u < least(w, x + radius + 1); u++) {
                    const int64_t k = labels[v * w + u];
                    int i = 0;
                    while (i < count && names[i] != k)
                        i++;
                    if (k < 0 || i < count || count == MOST_NEAR)
                        continue;
                    const float *shaded = shade(form[k], place[k], table + k * SHADES * c, c,
                        (double)x + 0.5, (double)y + 0.5);
                    names[count] = k;
                    for (int64_t j = 0; j < c; j++)
                        color[count][j] = shaded[j];
                    count++;
                }
            }
            if (extra_name >= 0) {
                names[count] = extra_name;
                memcpy(color[count++], extra, (size_t)c * sizeof *extra);
            }
            best = best_mixture(pixels + (y * w + x) * c, c, color, names, count);
        }
        error[m] = (float)best.error;
        for (int k = 0; k < 3; k++) {
            label[m][k] = best.label[k];
            share[m][k] = (float)best.share[k];
        }
    }
}
