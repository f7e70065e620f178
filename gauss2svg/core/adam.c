/* Adam's step of Gaussians, each in its own frame (gauss2svg.fit.state). */

#include "functions.h"

enum { COLUMNS = 10 };

/* Step n Gaussians in place, and return whether each step was finite. A Gaussian whose step would
not be finite stays as it is, but its moments of Adam and its age become 0.

moments        (n, 10) from walk_tiles, added up for each Gaussian
opacity_color  (n, 4), shape (n, 11) as in walk_tiles
mean, factor   (n, 2) and (n, 3) in px: the means, and l11, l21, l22 of the Cholesky factors L
raw_opacity, color, raw_beta  (n,) logits, (n, 3), and (n,) ln beta
m, v, age      (n, 10), (n, 10) and (n,) Adam's moments, and the number of steps that were taken
columns        (10, 3) rate, least and largest value of each column of the moments
decay          decay of the first and of the second moment
by_beta        power of beta by which steps of mean and shape are multiplied
sigmas         least and largest semi-axis in px, and their largest ratio
rim            exp of the largest ln beta of a shape whose minor semi-axis is 1 px
farthest       bound in px of |x| + |y| + l11 + |l21| + l22
price          a step raises ln beta only if this lowers the loss by more than `price` a unit
rate           factor of all rates

With the gradient g of t1, t2, A11, A12, A22, logit opacity, r, g, b and ln beta, and the decays p
and q, the step of each is

    m <- p m + (1 - p) g,  v <- q v + (1 - q) g^2,
    d = -rate sqrt(1 - q^age) / (1 - p^age) m / (sqrt(v) + 1e-12).

(Kingma and Ba, "Adam: A Method for Stochastic Optimization", 2015, end of section 2.) */
API int64_t step_gaussians(int64_t n, const double (*moments)[COLUMNS],
    const double (*opacity_color)[4], const double (*shape)[11], double (*mean)[2],
    double (*factor)[3], double *raw_opacity, double (*color)[3], double *raw_beta,
    double (*m)[COLUMNS], double (*v)[COLUMNS], double *age, const double (*columns)[3],
    const double decay[2], double by_beta, const double sigmas[3], double rim, double farthest,
    double price, double rate) {
    const double p = decay[0], q = decay[1];
    bool all_finite = true;
    for (int64_t i = 0; i < n; i++) {
        double d[COLUMNS], sum = 0.0;
        memcpy(d, moments[i], sizeof d);
        d[3] *= 2.0;
        d[5] *= 1.0 - opacity_color[i][0];
        d[9] = price - shape[i][5] * d[9];
        age[i] += 1.0;
        const double unbiased = -rate * sqrt(1.0 - power(q, age[i])) / (1.0 - power(p, age[i]));
        const double crisp = by_beta != 0.0 ? exponential(by_beta * raw_beta[i]) : 1.0;
        for (int k = 0; k < COLUMNS; k++) {
            m[i][k] = p * m[i][k] + (1.0 - p) * d[k];
            v[i][k] = q * v[i][k] + (1.0 - q) * (d[k] * d[k]);
            d[k] = columns[k][0] * unbiased * (m[i][k] / (sqrt(v[i][k]) + 1e-12));
            sum += d[k] + v[i][k];
            d[k] *= k < 5 ? crisp : 1.0;
        }
        double l11 = factor[i][0], l21 = factor[i][1], l22 = factor[i][2];
        const double x = mean[i][0] + l11 * d[0], y = mean[i][1] + l21 * d[0] + l22 * d[1];
        /* The covariance becomes L exp(2 A) L^T with A = [[a, c], [c, b]]. e is the Taylor series
        of exp(A) up to second order, and F = L e. However large the error of e is, F F^T is a
        covariance. */
        const double a = d[2], c = d[3], b = d[4];
        const double e11 = 1.0 + a + 0.5 * (a * a + c * c), e12 = c + 0.5 * c * (a + b);
        const double e22 = 1.0 + b + 0.5 * (b * b + c * c);
        const double f11 = l11 * e11, f12 = l11 * e12;
        const double f21 = l21 * e11 + l22 * e12, f22 = l21 * e12 + l22 * e22;
        double xx = f11 * f11 + f12 * f12, xy = f11 * f21 + f12 * f22, yy = f21 * f21 + f22 * f22;
        /* The singular values of F, from their sum and their difference, which is stable. */
        const double both = length(at(f11 + f22, f21 - f12));
        const double off = length(at(f11 - f22, f21 + f12));
        const double major = 0.5 * (both + off), minor = 0.5 * fabs(both - off);
        const double new_minor = clip(minor, sigmas[0], sigmas[1]);
        const double new_major = min(clip(major, sigmas[0], sigmas[1]), sigmas[2] * new_minor);
        if (new_minor != minor || new_major != major) {
            const double half = 0.5 * (square(new_major) + square(new_minor));
            const double part = 0.5 * (square(new_major) - square(new_minor));
            /* The double angle of the major axis has this cosine and this sine. */
            const double reach = length(at(xx - yy, 2.0 * xy));
            const double cosine = reach > 0.0 ? (xx - yy) / reach : 1.0;
            const double sine = reach > 0.0 ? 2.0 * xy / reach : 0.0;
            xx = half + part * cosine;
            yy = half - part * cosine;
            xy = part * sine;
        }
        l11 = sqrt(xx);
        l21 = xy / l11;
        l22 = sqrt(xx * yy - xy * xy) / l11;
        /* A sum is finite only if all of its terms are, so one test of a sum tests them all. */
        const double reach = fabs(x) + fabs(y) + l11 + fabs(l21) + l22;
        if (!(reach < farthest && l22 > 0.0 && fabs(sum) < INFINITY)) {
            all_finite = false;
            age[i] = 0.0;
            memset(m[i], 0, sizeof m[i]);
            memset(v[i], 0, sizeof v[i]);
            continue;
        }
        mean[i][0] = x;
        mean[i][1] = y;
        factor[i][0] = l11;
        factor[i][1] = l21;
        factor[i][2] = l22;
        if (columns[5][0] != 0.0)
            raw_opacity[i] = clip(raw_opacity[i] + d[5], columns[5][1], columns[5][2]);
        for (int k = 0; k < 3 && columns[6][0] != 0.0; k++)
            color[i][k] = clip(color[i][k] + d[6 + k], columns[6][1], columns[6][2]);
        if (columns[9][0] != 0.0) {
            const double sharpest = clip(logarithm(rim * new_minor), columns[9][1], columns[9][2]);
            raw_beta[i] = clip(raw_beta[i] + d[9], columns[9][1], sharpest);
        }
    }
    return all_finite;
}
