/* Elementary functions, products and linear equations of arrays (gauss2svg.portable). */

#include "functions.h"

/* Write a function of each of n numbers, or of each of n pairs. */
#define EACH(NAME, VALUE)                                                                          \
    API void NAME(                                                                                 \
        int64_t n, const double *restrict a, const double *restrict b, double *restrict out) {     \
        (void)b;                                                                                   \
        for (int64_t i = 0; i < n; i++)                                                            \
            out[i] = VALUE;                                                                        \
    }

EACH(each_exp, exponential(a[i]))
EACH(each_log, logarithm(a[i]))
EACH(each_cos, cosine(a[i]))
EACH(each_sin, sine(a[i]))
EACH(each_power, power(a[i], b[i]))
EACH(each_arctan2, angle_of(a[i], b[i]))

/* Write the product (n, m) of the matrices a (n, k) and b (k, m). Each element is added up from the
first product to the last. */
API void multiply(
    int64_t n, int64_t k, int64_t m, const double *a, const double *b, double *restrict out) {
    memset(out, 0, n * m * sizeof *out);
    for (int64_t i = 0; i < n; i++)
        for (int64_t l = 0; l < k; l++)
            for (int64_t j = 0; j < m; j++)
                out[i * m + j] += a[i * k + l] * b[l * m + j];
}

/* Return whether the matrix a (n, n) is regular, and replace b (n, m) by x with a x = b. This is
Gaussian elimination with row pivots, and changes a. */
API int64_t solve(int64_t n, int64_t m, double *a, double *b) {
    for (int64_t k = 0; k < n; k++) {
        int64_t pivot = k;
        for (int64_t i = k + 1; i < n; i++)
            pivot = fabs(a[i * n + k]) > fabs(a[pivot * n + k]) ? i : pivot;
        const double divisor = a[pivot * n + k];
        if (!(fabs(divisor) > 0.0))
            return false;
        for (int64_t j = 0; j < n + m && pivot != k; j++) {
            double *one = j < n ? a + k * n + j : b + k * m + j - n;
            double *other = j < n ? a + pivot * n + j : b + pivot * m + j - n;
            const double v = *one;
            *one = *other;
            *other = v;
        }
        for (int64_t i = k + 1; i < n; i++) {
            const double factor = a[i * n + k] / divisor;
            for (int64_t j = k; j < n && factor != 0.0; j++)
                a[i * n + j] -= factor * a[k * n + j];
            for (int64_t j = 0; j < m; j++)
                b[i * m + j] -= factor * b[k * m + j];
        }
    }
    for (int64_t k = n - 1; k >= 0; k--)
        for (int64_t j = 0; j < m; j++) {
            for (int64_t i = k + 1; i < n; i++)
                b[k * m + j] -= a[k * n + i] * b[i * m + j];
            b[k * m + j] /= a[k * n + k];
        }
    return true;
}

/* Solve products x = sums for one row of x (n, 3) after the other, in an order (n,) of rows. Each is
clipped to 0..1, and rounded to multiples of 1 / levels if levels is not 0. */
API void sweep_colors(int64_t n, const double *products, const double (*sums)[3],
    const double *diagonal, const int64_t *order, double levels, double (*x)[3]) {
    for (int64_t i = 0; i < n; i++) {
        const int64_t k = order[i];
        double left[3] = {sums[k][0], sums[k][1], sums[k][2]};
        for (int64_t j = 0; j < n; j++)
            for (int c = 0; c < 3; c++)
                left[c] -= products[k * n + j] * x[j][c];
        for (int c = 0; c < 3; c++) {
            const double best = x[k][c] + left[c] / diagonal[k];
            x[k][c] = clip(levels > 0.0 ? rint(best * levels) / levels : best, 0.0, 1.0);
        }
    }
}
