/* Noise of JPEG: means of what is alike, and mixtures of the cores beside a pixel. Values are luma
and two chromas (3,), and so is the height of their noise. */

#include "core.h"

enum { RADIUS = 3, FAR = 4 };              /* px of means, and of the colours of a mixture */
enum { MOST_NEAR = 12, MOST_COLORS = 16 }; /* colours that are tried: of cores nearby, and of all */
/* The rest is counted in noise: neighbours are alike within RANGE, chromas of two colours differ by
ALONG where they bleed, a pixel that differs less than SNAP from a colour is no mixture, and
EXPLAINED is the largest error of a mixture. */
static const double RANGE = 1.8, ALONG = 2.5, SNAP = 2.0, EXPLAINED = 4.0;

/* Write the mean of the neighbours of each pixel that are like it within its noise, all (h, w, 3).
*/
API void average_alike(
    int64_t h, int64_t w, const float (*values)[3], const float (*noise)[3], float (*result)[3]) {
    for (int64_t y = 0; y < h; y++) {
        for (int64_t x = 0; x < w; x++) {
            const float *own = values[y * w + x], *by = noise[y * w + x];
            float sum[3] = {0}, count = 0;
            for (int64_t v = most(0, y - RADIUS); v < least(h, y + RADIUS + 1); v++) {
                for (int64_t u = most(0, x - RADIUS); u < least(w, x + RADIUS + 1); u++) {
                    const float *other = values[v * w + u];
                    bool is_alike = true;
                    for (int c = 0; c < 3; c++)
                        is_alike &= fabsf(other[c] - own[c]) <= (float)RANGE * by[c];
                    count += is_alike ? 1.0f : 0.0f;
                    for (int c = 0; c < 3; c++)
                        sum[c] += is_alike ? other[c] : 0.0f;
                }
            }
            for (int c = 0; c < 3; c++)
                result[y * w + x][c] = sum[c] / count;
        }
    }
}

/* Write the share of colour a in the best mixture of two colours, and return its squared error in
noise. Luma is blurred less than chroma, so the share is that of luma, unless lumas are alike. */
static double mixture_error(
    const float *value, const float *a, const float *b, const float *noise, double *share) {
    const double contrast = a[0] - b[0], luma = value[0] - b[0];
    const double fine = 1.0 / square(noise[0]), coarse = 1.0 / square(ALONG * noise[1]);
    double chroma = 0.0, across = 0.0;
    for (int c = 1; c < 3; c++) {
        chroma += (value[c] - b[c]) * (a[c] - b[c]);
        across += square(a[c] - b[c]);
    }
    const double total = fine * square(contrast) + coarse * across;
    double s = 0.0;
    if (total > 1e-6)
        s = clip((fine * luma * contrast + coarse * chroma) / total, 0.0, 1.0);
    if (s * sqrt(total) < SNAP)
        s = 0.0;
    else if ((1.0 - s) * sqrt(total) < SNAP)
        s = 1.0;
    const double part = across > 1e-6 ? clip(chroma / across, 0.0, 1.0) : 0.0;
    double error = fine * square(luma - s * contrast) + coarse * square(part - s) * across;
    for (int c = 1; c < 3; c++)
        error += square((value[c] - b[c] - part * (a[c] - b[c])) / noise[1]);
    *share = s;
    return error;
}

/* Write the colours of cores, and mixtures of the two cores beside each pixel between them.

values, even  (h, w, 3) noisy values, and those of cores without noise
cores    (h, w) labels of the pixels of cores, else -1
colors   (count, 3) at most MOST_COLORS colours of which thin parts may be, beside the cores
noise    (h, w, 3) height of the noise
result   (h, w, 3) output. Pixels that are no mixtures keep what it has */
API void mix_cores(int64_t h, int64_t w, const float (*values)[3], const float (*even)[3],
    const int32_t *cores, int64_t colors_count, const float (*colors)[3], const float (*noise)[3],
    float (*result)[3]) {
    const float *color[MOST_NEAR + MOST_COLORS];
    int64_t names[MOST_NEAR], nearest[MOST_NEAR];
    for (int64_t pixel = 0; pixel < h * w; pixel++) {
        const int64_t y = pixel / w, x = pixel % w;
        if (cores[pixel] >= 0)
            memcpy(result[pixel], even[pixel], sizeof *result);
        double best = cores[pixel] >= 0 ? 0.0 : INFINITY;
        for (int64_t radius = 1; radius <= FAR + 1 && best > square(EXPLAINED); radius++) {
            int near = 0, first = 0, second = 0;
            double share = 0.0, s;
            for (int64_t v = most(0, y - radius); v < least(h, y + radius + 1); v++) {
                for (int64_t u = most(0, x - radius); u < least(w, x + radius + 1); u++) {
                    const int64_t core = cores[v * w + u];
                    const int64_t distance = (v - y) * (v - y) + (u - x) * (u - x);
                    int i = 0;
                    while (i < near && names[i] != core)
                        i++;
                    if (core < 0 || i == MOST_NEAR || (i < near && nearest[i] <= distance))
                        continue;
                    names[i] = core;
                    nearest[i] = distance;
                    color[i] = even[v * w + u];
                    near = i == near ? near + 1 : near;
                }
            }
            int count = near;
            for (int64_t i = 0; i < colors_count && radius > FAR; i++)
                color[count++] = colors[i];
            for (int i = 0; i < count; i++) {
                for (int j = 0; j < near && j <= i; j++) {
                    const double error =
                        mixture_error(values[pixel], color[i], color[j], noise[pixel], &s);
                    if (error < best) {
                        best = error;
                        first = i;
                        second = j;
                        share = s;
                    }
                }
            }
            for (int c = 0; c < 3 && best <= square(EXPLAINED); c++)
                result[pixel][c] =
                    (float)(share * color[first][c] + (1.0 - share) * color[second][c]);
        }
    }
}
