"""Additive blending of one tile: forward, backward and removal, sixteen lanes at a time.

    C = background + sum a_k c_k,  a_k = f(r_k),

with signed colours and in any order, so that each gradient depends on its own pair alone:

    dL/da_k = g . c_k,  dL/dc_k = sum a_k g.

Lanes, buffers, shapes and moments are those of gauss2svg.render.kernels, with an opacity of 1
and all exponents 1. A pair takes about 0.8 of the time of an alpha-composited one
(docs/decisions/kernels.md).
"""

# pyright: reportCallIssue=false
# The intrinsics of simd.py take a typing context that numba passes by itself.

from numba import njit

from gauss2svg.render.kernels import PLANE, falloff_row, put_moments, rim_of_gaussians, whitened
from gauss2svg.render.simd import least, load, splat, store, total
from gauss2svg.render.threads import tile_kernel
from gauss2svg.render.tiles import TILE_WIDTH


@njit(inline="always")
def _color_of(i, opacity_color, like):
    """Lanes of each channel of Gaussian i."""
    return (
        splat(opacity_color[i, 1], like),
        splat(opacity_color[i, 2], like),
        splat(opacity_color[i, 3], like),
    )


@tile_kernel
def compose_additive_tile(
    order, first, end, x0, y0, column, inside, shape, opacity_color, gaussian, rows, alpha, color
):
    """Add up the pairs of one tile in color (3, TILE_HEIGHT, 16), and keep falloffs in alpha.

    Arguments as those of gauss2svg.render.kernels.compose_tile.
    """
    columns = load(column, 0)
    mask = load(inside, 0)
    zero = splat(0.0, mask)
    for j in range(0, 3 * PLANE, TILE_WIDTH):
        store(color, j, zero)
    at = 0
    for k in range(first, end):
        p = order[k]
        i = gaussian[p]
        c0, c1, c2 = _color_of(i, opacity_color, mask)
        z1, across, middle = whitened(i, p, x0, y0, columns, mask, shape, rows)
        z1 = z1 * z1
        w22 = shape[i, 4]
        for y in range(rows[p, 0] - y0, rows[p, 1] - y0):
            z2 = across + splat(w22 * (y - middle), mask)
            a = falloff_row(z1 + z2 * z2) * mask
            store(alpha, at, a)
            at += TILE_WIDTH
            j = y * TILE_WIDTH
            store(color, j, load(color, j) + a * c0)
            store(color, j + PLANE, load(color, j + PLANE) + a * c1)
            store(color, j + 2 * PLANE, load(color, j + 2 * PLANE) + a * c2)


@tile_kernel
def backpropagate_additive_tile(
    order, first, end, x0, y0, column, shape, opacity_color, gaussian, rows, alpha, g, moments
):  # fmt: skip
    """Moments (p, MOMENTS) of every pair of a tile; g (3, TILE_HEIGHT, 16) is dL/dpixel."""
    columns = load(column, 0)
    centre = load(g, 0)
    zero = splat(0.0, centre)
    rim = rim_of_gaussians(centre)
    large = splat(1e30, centre)
    row = 0
    for k in range(first, end):
        p = order[k]
        i = gaussian[p]
        c0, c1, c2 = _color_of(i, opacity_color, centre)
        z1, across, middle = whitened(i, p, x0, y0, columns, centre, shape, rows)
        w22 = shape[i, 4]
        s0 = s1 = s2 = so = h0 = h2 = h22 = zero
        for y in range(rows[p, 0] - y0, rows[p, 1] - y0):
            j = y * TILE_WIDTH
            a = load(alpha, row)
            row += TILE_WIDTH
            g0 = load(g, j)
            g1 = load(g, j + PLANE)
            g2 = load(g, j + 2 * PLANE)
            z2 = across + splat(w22 * (y - middle), centre)
            d = g0 * c0 + g1 * c1 + g2 * c2
            s0 = s0 + a * g0
            s1 = s1 + a * g1
            s2 = s2 + a * g2
            so = so + a * d
            # rim where alpha > 0, 0 where it is 0, without a branch
            h = (a + least(rim, a * large)) * d
            hz = h * z2
            h0 = h0 + h
            h2 = h2 + hz
            h22 = h22 + hz * z2
        put_moments(moments, p, z1, h0 * z1, h2, h22, so, s0, s1, s2, zero)


@tile_kernel
def removal_additive_tile(
    order, first, end, y0, opacity_color, gaussian, rows, alpha, error, weight, cost
):  # fmt: skip
    """Change of the weighted sum of squared errors if a pair's Gaussian alone were removed.

    Its pixels change by d = -a c, the sum by weight d.(d + 2 error). cost (p, 2): that, and the
    sum of weight a^2, written; error (3, TILE_HEIGHT, 16) rendered - target, 0 outside the image.
    """
    zero = splat(0.0, error)
    row = 0
    for k in range(first, end):
        p = order[k]
        i = gaussian[p]
        change = zero
        mass = zero
        for y in range(rows[p, 0] - y0, rows[p, 1] - y0):
            a = load(alpha, row)
            row += TILE_WIDTH
            counts = load(weight, y * TILE_WIDTH)
            mass = mass + counts * (a * a)
            for channel in range(3):
                d = a * splat(-opacity_color[i, 1 + channel], error)
                e = load(error, channel * PLANE + y * TILE_WIDTH)
                change = change + counts * (d * (d + e + e))
        cost[p, 0] = total(change)
        cost[p, 1] = total(mass)
