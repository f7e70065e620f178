/* Sums of additive Gaussians at samples, and how far one would leave a range of values
(gauss2svg.svg.additive). The unit of length is a cell of the grid of samples. */

#include "core.h"

enum { STEPS = 4096 }; /* of the table of the falloff, equal steps of the squared radius */
/* If a Gaussian changes a channel of a sample by no more than this, its total is not compared. */
static const double LEAST_CHECKED = 1e-3;

/* m samples and n Gaussians.

samples, start  (m, 2) x and y, and (rows + 1,) the first sample of each row, in which x grows
falloff  (STEPS + 1,) from the mean to the cut at `radius`
mean, whitening, reach, color  (n, 2), (n, 3) w11, w21, w22, (n, 2) reach in x and y, and (n, 3)
picture  (m, 3) the sum of all Gaussians and the background. Totals may leave low..high (3,) as far
         as it does */
typedef struct {
    int64_t rows;
    double radius;
    const float (*samples)[2];
    const int64_t *start;
    const double *falloff, (*mean)[2], (*whitening)[3], (*reach)[2], (*color)[3];
    const float (*picture)[3];
    const double *low, *high;
} Grid;

/* Return the falloff of Gaussian i at a sample, by linear interpolation in the table. */
static double alpha_at(const Grid *g, int64_t i, int64_t sample) {
    const double *w = g->whitening[i];
    const double u = g->samples[sample][0] - g->mean[i][0],
                 v = g->samples[sample][1] - g->mean[i][1];
    const double step =
        (square(w[0] * u) + square(w[1] * u + w[2] * v)) * (STEPS / square(g->radius));
    const int64_t k = (int64_t)min(step, STEPS - 1);
    if (step >= STEPS)
        return 0.0;
    return g->falloff[k] + (step - (double)k) * (g->falloff[k + 1] - g->falloff[k]);
}

/* Return the first of the samples first..end of a row whose x is at least `left`. */
static int64_t sample_from(const Grid *g, int64_t first, int64_t end, double left) {
    while (first < end) {
        const int64_t middle = (first + end) / 2;
        if (g->samples[middle][0] < left)
            first = middle + 1;
        else
            end = middle;
    }
    return first;
}

/* Visit the samples that Gaussian i may reach, and return its largest excess. If totals (m, 3) are
given with `lowest` and `highest`, add it to them instead. The visit ends at an excess of at least
`enough`.

In a row, the Gaussian is widest at the height nearest to the mean. A tilted one has its centre at a
different x at each height, so the interval is widened at each end by half of its move in a row. */
static double visit(const Grid *g, int64_t i, float (*total)[3], float (*lowest)[3],
    float (*highest)[3], double enough) {
    const double *w = g->whitening[i], *reach = g->reach[i], x = g->mean[i][0], y = g->mean[i][1];
    const double across = w[0] * w[0] + w[1] * w[1], ridge = -w[1] * w[2] / across;
    const int64_t end = (int64_t)ceil(clip(y + reach[1], 0.0, (double)g->rows));
    double excess = 0.0;
    for (int64_t row = (int64_t)clip(y - reach[1], 0.0, (double)g->rows); row < end; row++) {
        const double v = (double)row + 0.5 - y, near = clip((fabs(v) - 0.5) / reach[1], 0.0, 1.0);
        const double half = g->radius * sqrt((1.0 - near * near) / across) + 0.5 * fabs(ridge);
        const double left = x + max(ridge * v - half, -reach[0]);
        const double right = x + min(ridge * v + half, reach[0]);
        int64_t sample = sample_from(g, g->start[row], g->start[row + 1], left);
        const int64_t last = sample_from(g, sample, g->start[row + 1], right);
        for (; sample < last && excess < enough; sample++) {
            const double alpha = alpha_at(g, i, sample);
            for (int c = 0; c < 3; c++) {
                const double added = alpha * g->color[i][c], after = total[sample][c] + added;
                double own = 0.0;
                if (lowest != NULL) {
                    total[sample][c] = (float)after;
                    lowest[sample][c] = fminf(lowest[sample][c], (float)after);
                    highest[sample][c] = fmaxf(highest[sample][c], (float)after);
                } else if (added > LEAST_CHECKED) {
                    own = after - max(g->high[c], g->picture[sample][c]);
                } else if (added < -LEAST_CHECKED) {
                    own = min(g->low[c], g->picture[sample][c]) - after;
                }
                excess = max(excess, own);
            }
        }
    }
    return excess;
}

/* Try `count` Gaussians in their order. If `enough` is not INFINITY, draw each whose excess is
below it, and return how many were drawn. Else draw none, and return the Gaussian with the least
excess.

indices, is_drawn  (count,) Gaussians, and (n,) whether each has been drawn, which is changed
total    (m, 3) sums of the background and all Gaussians drawn so far, which are changed
lowest, highest  (m, 3) the lowest and the highest total that each sample has had
The other arguments are the fields of Grid. */
API int64_t draw_gaussians(int64_t rows, double radius, const float (*samples)[2],
    const int64_t *start, const double *falloff, const double (*mean)[2],
    const double (*whitening)[3], const double (*reach)[2], const double (*color)[3],
    const float (*picture)[3], const double *low, const double *high, int64_t count,
    const int64_t *indices, double enough, bool *is_drawn, float (*total)[3], float (*lowest)[3],
    float (*highest)[3]) {
    const Grid g = {
        rows, radius, samples, start, falloff, mean, whitening, reach, color, picture, low, high};
    double least_excess = enough;
    int64_t drawn = 0, best = -1;
    for (int64_t k = 0; k < count; k++) {
        const int64_t i = indices[k];
        const double excess = visit(&g, i, total, NULL, NULL, least_excess);
        if (excess >= least_excess)
            continue;
        best = i;
        if (enough == INFINITY) {
            least_excess = excess;
        } else {
            visit(&g, i, total, lowest, highest, INFINITY);
            is_drawn[i] = true;
            drawn++;
        }
    }
    return enough == INFINITY ? best : drawn;
}
