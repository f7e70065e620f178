"""Blending of one tile: the forward pass, the backward pass and the cost of removing a Gaussian.

The kernels compute sixteen lanes at a time, one lane for each pixel in a row of the tile. All
buffers are float32 or all are float64, and lanes are computed in that dtype. The arrays `shape` and
`opacity_color` are always float64.

Each pixel is blended from front to back. With T_k the transmittance in front of Gaussian k,

    alpha_k = opacity_k f(r_k),  w_k = alpha_k T_k,  C = sum w_k c_k + T_end background,
    T_{k+1} = T_k - w_k.

The forward pass leaves alpha_k and T_k in the buffers. The backward pass walks from back to front
and does not divide by 1 - alpha. With g the gradient with respect to the pixel, and B_k the colour
of everything that is behind k,

    dL/dalpha_k = T_k (g.c_k - g.B_k),  B_{k-1} = B_k + alpha_k (c_k - B_k).

Shapes are evaluated in whitened coordinates z = W (x - mean) with r^2 = |z|^2, so that rounding
cannot make a squared term negative for thin Gaussians. z1 depends only on the column, and z2 takes
one multiply-add. The gradients of all parameters follow from nine numbers for each pair. Five of
these are moments of h = dL/dalpha alpha', where alpha' = alpha + opacity rim / (1 - rim) inside the
support, so that dL/dr^2 = -h / 2. The nine numbers are

    sum h z1, sum h z2, sum h z1^2, sum h z1 z2, sum h z2^2,
    sum dL/dalpha alpha, sum w g (3).

If the exponent beta of a shape is not 1, the falloff has t = s^beta in place of s = r^2 / 2. Its h
is multiplied by beta A with A = t / s = s^(beta - 1), which takes one logarithm and one power. A
tenth number is sum dL/dalpha alpha' t ln s, which is the negative of dL/dbeta.

A plain ellipse has no falloff but covers a share of each pixel (gauss2svg.scene.falloff). If it is
wider than a pixel, alpha = opacity clip(1/2 + (R - r) / g) with g = n / r and n = |W^T z|. The
gradient takes g as constant, so h = dL/dalpha opacity / n for pixels on the rim, and h = 0 for
other pixels.

Additive blending is C = background + sum a_k c_k with a_k = f(r_k). Colours are signed, and the
order of the shapes does not matter. So dL/da_k = g.c_k and dL/dc_k = sum a_k g. For additive
blending, the kernels are compiled with None as `transmittance`, and read no opacities or exponents.
"""

# pyright: reportCallIssue=false
# Calls of the intrinsics of simd.py lack their first argument, typingctx, because numba adds it.
# pyright would report these calls as errors.

from numba import njit

from gauss2svg.render.simd import (
    LANES,
    LOG2_E,
    constant,
    exp2,
    least,
    load,
    log,
    most,
    narrow,
    polynomial,
    root,
    splat,
    store,
    total,
)
from gauss2svg.render.tiles import TILE_HEIGHT, TILE_WIDTH, tile_kernel
from gauss2svg.scene.falloff import CUT, RIM

assert TILE_WIDTH == LANES, "one tile row is one value of sixteen lanes"
PLANE = TILE_WIDTH * TILE_HEIGHT
MOMENTS = 10
# If r^2 / 2 is smaller than this value, its logarithm and its powers are computed with this value
# instead, because the logarithm of 0 would be infinite.
LOGARITHM_FROM = 1e-12

# Coefficients of a polynomial p(u) that approximates exp(u) on -1.125..0. They come from least
# squares on Chebyshev nodes with p(0) = 1. The kernels compute exp(-q / 2) for 0 <= q <= 9 as the
# fourth power of p(-q / 8). Its error, with rounding, is at most 2e-6 in float32. In float64 its
# relative error is at most 3e-15.
_SINGLE = (0.99998307, 0.4996931, 0.1650935, 0.03830978, 0.0050456)
_DOUBLE = (
    0.9999999999999957, 0.49999999999975975, 0.16666666666191254, 0.041666666618940265,
    0.008333333050006783, 0.0013888878096905864, 0.00019840993722197286, 2.4796730136219152e-05,
    2.7498246355397565e-06, 2.706659751805855e-07, 2.236377895720017e-08, 1.1844917963299862e-09,
)  # fmt: skip
_SQUARE_CUT = 2 * CUT  # r^2 at which a Gaussian is cut off


def _rim_of(coefficients: tuple[float, ...]) -> float:
    value = 0.0
    for coefficient in reversed((1.0, *coefficients)):
        value = coefficient - _SQUARE_CUT / 8 * value
    return value**4


# Values of exp(-r^2 / 2) at the cut, as the polynomials for float32 and float64 give them. Slightly
# more than the rounding errors is added, so that alpha is exactly 0 from the cut on.
_RIMS = _rim_of(_SINGLE) + 2e-8, _rim_of(_DOUBLE) + 4e-17
assert abs(_RIMS[0] - RIM) < 2e-6, "the polynomials were fitted for RADIUS = 3"
assert abs(_RIMS[1] - RIM) < 1e-16, "the polynomials were fitted for RADIUS = 3"
_rim = constant(*_RIMS)
_norm = constant(*(1 / (1 - rim) for rim in _RIMS))
_exp = polynomial(_SINGLE, _DOUBLE)
# Shapes with beta != 1 use these values in place of _RIMS. They are larger than _RIMS, because
# s^beta at the cut has an error of up to 2e-5 in float32.
_POWER_RIMS = RIM + 2e-6, RIM + 1e-14
_power_rim = constant(*_POWER_RIMS)
_power_norm = constant(*(1 / (1 - rim) for rim in _POWER_RIMS))
# A small number that is added to r^2 and n^2 of a plain ellipse, so that r / n is finite even at
# the mean.
_least_square = constant(1e-20, 1e-60)


@njit(inline="always")
def _exp_half(q):
    """Return exp(-q / 2) lane by lane for 0 <= q <= 9."""
    p = _exp(q * splat(-0.125, q))
    p = p * p
    return p * p


@njit(inline="always")
def _whitened(i, p, x0, y0, column, like, shape, rows):
    """Return z1 and z2 on the middle row of pair p, and the number of this row in the tile.

    z1 and z2 are lanes of the type of `like`. From each row to the next, z2 grows by w22. Pairs of
    the thinnest shapes have only one row (gauss2svg.render.tiles).

    z1 and z2 are computed in float64 and then rounded, because float32 is too coarse for offsets
    from a distant mean and for offsets within a shape of sigma 1e-6 px. Moreover, z2 of a thin
    sheared shape is the sum of two terms that nearly cancel.
    """
    middle = (rows[p, 0] + rows[p, 1]) // 2
    u = column + splat(x0 + 0.5 - shape[i, 0], column)
    v = splat(shape[i, 4] * (middle + 0.5 - shape[i, 1]), column)
    z2 = splat(shape[i, 3], column) * u + v
    return narrow(splat(shape[i, 2], column) * u, like), narrow(z2, like), middle - y0


@njit(inline="always")
def _covered(i, z1, z2, radius, shape):
    """Return how much of each pixel a plain ellipse covers, and the slope of this share.

    The slope is the derivative of the share with respect to r, times -1 / r. It is 1 / n for pixels
    on the near rim, -1 / n for pixels on the far rim, and 0 for other pixels. The module's
    docstring defines r, n and R. Here R is the argument `radius`.
    """
    zero, half, one = splat(0.0, z1), splat(0.5, z1), splat(1.0, z1)
    huge = splat(1e30, z1)
    tiny = splat(_least_square(z1), z1)
    o1 = splat(shape[i, 7], z1) * z1
    o2 = splat(shape[i, 8], z1) * z1 + splat(shape[i, 9], z1) * z2
    inside = least(one, most(zero, one - (o1 * o1 + o2 * o2)) * huge)
    n1 = splat(shape[i, 2], z1) * z1 + splat(shape[i, 3], z1) * z2
    n2 = splat(shape[i, 4], z1) * z2
    r = root(z1 * z1 + z2 * z2 + tiny)
    inverse_n = one / root(n1 * n1 + n2 * n2 + tiny)
    px = r * inverse_n
    near = most(zero, half + (radius - r) * px)
    far = half + (radius + r) * px
    # on_near_rim is 1 for pixels on the near rim, and on_far_rim for pixels on the far rim. For
    # other pixels both are 0. They are computed by minima and maxima, because these need no branch.
    on_near_rim = least(one, near * huge) * least(one, most(zero, one - near) * huge)
    on_far_rim = least(one, most(zero, one - far) * huge)
    share = least(one, near) + least(one, far) - one
    share = least(splat(shape[i, 10], z1), most(zero, share))
    return inside * share, inside * ((on_near_rim - on_far_rim) * inverse_n)


@njit(inline="always")
def _kind(i, shape, opacity_color, transmittance, like):
    """Return four values of shape i: is_plain, has_power, the opacity and rim / (1 - rim).

    has_power says whether the falloff has an exponent beta other than 1. rim is exp(-s^beta) at the
    cut.
    """
    if transmittance is None:
        return False, False, 1.0, _norm(like) * _rim(like)
    is_plain = shape[i, 7] != 0.0
    has_power = shape[i, 5] != 1.0 and not is_plain
    rim = _power_norm(like) * _power_rim(like) if has_power else _norm(like) * _rim(like)
    return is_plain, has_power, opacity_color[i, 0], rim


@njit(inline="always")
def _layer(y, at, a, c0, c1, c2, alpha, transmittance, color, remaining):
    """Blend a shape behind those already on row y of a tile. Store its alpha in the buffers.

    a           lanes of the shape's alpha
    c0, c1, c2  lanes of its colour
    at          index in the buffers at which alpha and transmittance are stored
    Return the index after the stored numbers.
    """
    j = y * TILE_WIDTH
    w = a
    if transmittance is not None:
        t = load(remaining, j)
        store(transmittance, at, t)
        w = a * t
        store(remaining, j, t - w)
    store(alpha, at, a)
    store(color, j, load(color, j) + w * c0)
    store(color, j + PLANE, load(color, j + PLANE) + w * c1)
    store(color, j + 2 * PLANE, load(color, j + 2 * PLANE) + w * c2)
    return at + TILE_WIDTH


@tile_kernel
def compose_tile(
    order, first, end, x0, y0, column, inside, shape, opacity_color, gaussian, rows,
    alpha, transmittance, steep, logs, color, remaining,
):  # fmt: skip
    """Blend the pairs of one tile. Return how many numbers of each flat buffer are filled.

    order[first:end]  indices of the tile's pairs, from front to back
    x0, y0         first pixel of the tile
    column         (16,) float64: 0, 1, .., 15
    inside         (16,) 1 for columns of the image, and 0 for columns beyond its right edge, which
                   do not count
    shape          (n, 11) float64: mean x, y, whitening w11, w21, w22, beta, R^2, o11, o21, o22 and
                   the largest share (gauss2svg.render.cpu.Splats). R is the radius of the cut, or
                   that of the rim of a plain ellipse
    opacity_color  (n, 4) float64: opacity, r, g, b
    alpha          flat buffer of 16 numbers for each row of each pair, in the order of blending
    transmittance  such a buffer, or None for additive blending
    steep          such a buffer for s^(beta - 1), or for the slope of _covered if the shape is a
                   plain ellipse. It is not written for Gaussians (beta = 1)
    logs           such a buffer for ln s. It is only written for shapes with beta != 1 that are not
                   plain ellipses
    color          (3, TILE_HEIGHT, 16) output: sum of w c
    remaining      (TILE_HEIGHT, 16) output: transmittance behind all pairs. It is not written for
                   additive blending
    """
    columns = load(column, 0)
    mask = load(inside, 0)
    zero = splat(0.0, mask)
    half = splat(0.5, mask)
    tiny = splat(LOGARITHM_FROM, mask)
    for y in range(0, PLANE, TILE_WIDTH):
        if transmittance is not None:
            store(remaining, y, mask)
        for channel in range(3):
            store(color, channel * PLANE + y, zero)
    at = 0
    for k in range(first, end):
        p = order[k]
        i = gaussian[p]
        is_plain, has_power, opacity, f_rim = _kind(i, shape, opacity_color, transmittance, mask)
        peak = splat(opacity * (_power_norm(mask) if has_power else _norm(mask)), mask)
        rim = splat(opacity * f_rim, mask)
        c0 = splat(opacity_color[i, 1], mask)
        c1 = splat(opacity_color[i, 2], mask)
        c2 = splat(opacity_color[i, 3], mask)
        z1, across, middle = _whitened(i, p, x0, y0, columns, mask, shape, rows)
        square = z1 * z1
        power = splat((shape[i, 5] - 1.0) * LOG2_E, mask)
        reach = splat(shape[i, 6], mask)
        w22 = shape[i, 4]
        # Plain ellipses are drawn in a loop of their own, so that the loop below is shorter and
        # needs no test for them.
        if transmittance is not None and is_plain:
            opacity_lanes = splat(opacity, mask)
            radius = root(reach)
            for y in range(rows[p, 0] - y0, rows[p, 1] - y0):
                z2 = across + splat(w22 * (y - middle), mask)
                share, slope = _covered(i, z1, z2, radius, shape)
                store(steep, at, slope)
                at = _layer(
                    y, at, opacity_lanes * share, c0, c1, c2, alpha, transmittance, color, remaining
                )
            continue
        for y in range(rows[p, 0] - y0, rows[p, 1] - y0):
            z2 = across + splat(w22 * (y - middle), mask)
            q = least(square + z2 * z2, reach)
            if transmittance is not None and has_power:
                ln = log(most(q * half, tiny))
                steepness = exp2(ln * power)
                store(steep, at, steepness)
                store(logs, at, ln)
                q = steepness * q
            a = most(peak * _exp_half(q) - rim, zero)
            if transmittance is None:
                a = a * mask
            at = _layer(y, at, a, c0, c1, c2, alpha, transmittance, color, remaining)
    return at


@tile_kernel
def backpropagate_tile(
    order, first, end, x0, y0, column, shape, opacity_color, gaussian, rows,
    alpha, transmittance, steep, logs, at, g, behind, moments,
):  # fmt: skip
    """Write the moments of every pair of a blended tile.

    The module's docstring has the formulas. Arguments that are not listed are as in compose_tile.

    at       number of elements that compose_tile has filled in each buffer. compose_tile returns it
    g        (3, TILE_HEIGHT, 16) dL/dpixel, which is 0 outside the image
    behind   (TILE_HEIGHT, 16) g.background on entry. It is overwritten
    moments  (p, MOMENTS) output: one row for each pair
    """
    columns = load(column, 0)
    centre = load(g, 0)
    zero = splat(0.0, centre)
    huge = splat(1e30, centre)
    for k in range(end - 1, first - 1, -1):
        p = order[k]
        i = gaussian[p]
        is_plain, has_power, opacity, f_rim = _kind(i, shape, opacity_color, transmittance, centre)
        rim = splat(opacity * (1.0 if is_plain else f_rim), centre)
        c0 = splat(opacity_color[i, 1], centre)
        c1 = splat(opacity_color[i, 2], centre)
        c2 = splat(opacity_color[i, 3], centre)
        z1, across, middle = _whitened(i, p, x0, y0, columns, centre, shape, rows)
        at -= (rows[p, 1] - rows[p, 0]) * TILE_WIDTH
        row = at
        reach = splat(shape[i, 6], centre)
        s0 = s1 = s2 = so = h0 = h2 = h22 = hb = zero
        for y in range(rows[p, 0] - y0, rows[p, 1] - y0):
            j = y * TILE_WIDTH
            z2 = across + splat(shape[i, 4] * (y - middle), centre)
            a = load(alpha, row)
            g0 = load(g, j)
            g1 = load(g, j + PLANE)
            g2 = load(g, j + 2 * PLANE)
            d = g0 * c0 + g1 * c1 + g2 * c2
            # `rest` is `rim` where alpha > 0, and 0 elsewhere. It is computed as a minimum, because
            # a minimum needs no branch.
            rest = least(rim, a * huge)
            if transmittance is None:
                w = a
                wd = a * d
                h = (a + rest) * d
            else:
                t = load(transmittance, row)
                b = load(behind, j)
                d = d - b
                store(behind, j, b + a * d)
                w = a * t
                wd = w * d
                h = wd + rest * (t * d)
                if is_plain:
                    h = (h - wd) * load(steep, row)
                if has_power:
                    h = h * load(steep, row)
                    hb = hb + h * (least(z1 * z1 + z2 * z2, reach) * load(logs, row))
            s0 = s0 + w * g0
            s1 = s1 + w * g1
            s2 = s2 + w * g2
            so = so + wd
            hz = h * z2
            h0 = h0 + h
            h2 = h2 + hz
            h22 = h22 + hz * z2
            row += TILE_WIDTH
        beta = splat(shape[i, 5] if has_power else 1.0, centre)
        h0 = h0 * beta
        h2 = h2 * beta
        h22 = h22 * beta
        moments[p, 0] = total(h0 * z1)
        moments[p, 1] = total(h2)
        moments[p, 2] = total(h0 * z1 * z1)
        moments[p, 3] = total(h2 * z1)
        moments[p, 4] = total(h22)
        moments[p, 5] = total(so)
        moments[p, 6] = total(s0)
        moments[p, 7] = total(s1)
        moments[p, 8] = total(s2)
        moments[p, 9] = 0.5 * total(hb)


@tile_kernel
def removal_tile(
    order, first, end, y0, opacity_color, gaussian, rows, alpha, transmittance, at, error, weight,
    behind, cost,
):  # fmt: skip
    """Write for each pair how the weighted squared error would change without its Gaussian.

    Without Gaussian k, a pixel changes by d = w_k (B_k - c_k), or with additive blending by
    d = -a_k c_k. So its weighted squared error changes by weight d.(d + 2 error). Arguments that
    are not listed are as in backpropagate_tile.

    error   (3, TILE_HEIGHT, 16) rendered - target, which is 0 outside the image
    weight  (TILE_HEIGHT, 16) weights of the pixels
    behind  (3, TILE_HEIGHT, 16) the background on entry. It is overwritten
    cost    (p, 2) output for each pair: the change, and the sum of weight w_k^2
    """
    zero = splat(0.0, error)
    for k in range(end - 1, first - 1, -1):
        p = order[k]
        i = gaussian[p]
        at -= (rows[p, 1] - rows[p, 0]) * TILE_WIDTH
        row = at
        change = zero
        mass = zero
        for y in range(rows[p, 0] - y0, rows[p, 1] - y0):
            w = a = load(alpha, row)
            if transmittance is not None:
                w = a * load(transmittance, row)
            row += TILE_WIDTH
            pixel_weight = load(weight, y * TILE_WIDTH)
            mass = mass + pixel_weight * (w * w)
            for channel in range(3):
                j = channel * PLANE + y * TILE_WIDTH
                difference = splat(-opacity_color[i, 1 + channel], error)
                if transmittance is not None:
                    b = load(behind, j)
                    difference = b + difference
                    store(behind, j, b - a * difference)
                d = w * difference
                e = load(error, j)
                change = change + pixel_weight * (d * (d + e + e))
        cost[p, 0] = total(change)
        cost[p, 1] = total(mass)
