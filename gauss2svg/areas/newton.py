"""Kernels of a step of Gauss-Newton: its Jacobian as samples, and conjugate gradients.

The parameters are the coordinates of all points, x and y in turns, and then the widths of layers.
"""

from __future__ import annotations

import math

import numpy as np

from gauss2svg.areas.kernels import inner, kernel
from gauss2svg.render.coverage import point_at

RATE = 4.0  # samples for each px of an outline
ACROSS = 6  # samples along the end of a stroke


@kernel
def list_samples(
    segment, curved, first_of, last_of, layer_of, sign, width, box, offset, weight, columns, pixel,
    owner, jacobian, weights,
):  # fmt: skip
    """List what a move of outlines changes, one entry for each pixel that a segment runs through.

    first_of, last_of  (k,) whether a segment begins or ends an open path
    layer_of, sign  (k,) layer of a segment, and 1 or -1 for the side on which its area lies
    pixel, owner  (n,) outputs: pixel y * columns + x, and segment
    jacobian  (n, 9) output: derivatives of its coverage by the segment's four control points, and
              by the width
    weights   (n, c) output: derivative of the pixel by its coverage
    Return the number of entries.
    """
    n = 0
    channels = weight.shape[1]
    basis = np.empty(4)
    for s in range(len(segment)):
        p, l = segment[s], layer_of[s]
        length = math.hypot(p[3, 0] - p[0, 0], p[3, 1] - p[0, 1])
        if curved[s]:
            length = 0.0
            for i in range(3):
                length += math.hypot(p[i + 1, 0] - p[i, 0], p[i + 1, 1] - p[i, 1])
        count = max(int(RATE * length), 4)
        is_stroke = width[l] > 0
        for side in range(4 if is_stroke else 1):
            if (side == 2 and not first_of[s]) or (side == 3 and not last_of[s]):
                continue
            steps = ACROSS if side >= 2 else count
            last = -1
            for i in range(steps):
                t = (i + 0.5) / steps
                if side >= 2:
                    t = float(side - 2)
                u = 1.0 - t
                if curved[s]:
                    basis[0], basis[1], basis[2], basis[3] = (
                        u * u * u,
                        3 * u * u * t,
                        3 * u * t * t,
                        t * t * t,
                    )
                else:
                    basis[0], basis[1], basis[2], basis[3] = u, 0.0, 0.0, t
                x, y, tx, ty = point_at(p, curved[s], t)
                wider = 0.0
                if not is_stroke:
                    nx, ny = sign[s] * ty / count, -sign[s] * tx / count
                else:
                    speed = math.hypot(tx, ty) + 1e-12
                    if side < 2:
                        e = 1.0 if side == 0 else -1.0
                        x += e * 0.5 * width[l] * ty / speed
                        y -= e * 0.5 * width[l] * tx / speed
                        nx, ny = e * ty / count, -e * tx / count
                        wider = 0.5 * speed / count
                    else:
                        off = ((i + 0.5) / steps - 0.5) * width[l]
                        x += off * ty / speed
                        y -= off * tx / speed
                        e = (-1.0 if side == 2 else 1.0) * width[l] / steps / speed
                        nx, ny = e * tx, e * ty
                px, py = int(math.floor(x)), int(math.floor(y))
                if not (
                    box[l, 0] <= px < box[l, 0] + box[l, 2]
                    and box[l, 1] <= py < box[l, 1] + box[l, 3]
                ):
                    last = -1
                    continue
                if py * columns + px != last:
                    last = py * columns + px
                    at = offset[l] + (py - box[l, 1]) * box[l, 2] + px - box[l, 0]
                    pixel[n], owner[n] = last, s
                    jacobian[n, :] = 0.0
                    for c in range(channels):
                        weights[n, c] = weight[at, c]
                    n += 1
                for k in range(4):
                    jacobian[n - 1, 2 * k] += basis[k] * nx
                    jacobian[n - 1, 2 * k + 1] += basis[k] * ny
                jacobian[n - 1, 8] += wider
    return n


@inner
def _expand(free, same, handle, node, master, ratio, full):
    for i in range(len(same)):
        full[i] = free[same[i]]
    for i in range(len(same), len(free)):
        full[i] = free[i]
    for t in range(len(handle)):
        for c in range(2):
            n, m = full[2 * node[t] + c], full[2 * master[t] + c]
            full[2 * handle[t] + c] = n + ratio[t] * (n - m)


@inner
def _reduce(full, same, handle, node, master, ratio, free):
    """Write the gradient by free parameters, and 0 for the others. `full` is changed."""
    for t in range(len(handle)):
        for c in range(2):
            g = full[2 * handle[t] + c]
            full[2 * handle[t] + c] = 0.0
            full[2 * node[t] + c] += (1.0 + ratio[t]) * g
            full[2 * master[t] + c] -= ratio[t] * g
    free[:] = 0.0
    for i in range(len(same)):
        free[same[i]] += full[i]
    for i in range(len(same), len(free)):
        free[i] = full[i]


@inner
def _transposed(place, owner, jacobian, weights, points, widths, layer_of, image, full):
    """Write the gradient by all parameters of a gradient by pixels, image (pixels, c)."""
    full[:] = 0.0
    for r in range(len(place)):
        s = owner[r]
        g = 0.0
        for c in range(weights.shape[1]):
            g += image[place[r], c] * weights[r, c]
        full[widths + layer_of[s]] += g * jacobian[r, 8]
        for k in range(4):
            q = 2 * points[s, k]
            full[q] += g * jacobian[r, 2 * k]
            full[q + 1] += g * jacobian[r, 2 * k + 1]


@kernel
def solve(
    place, owner, jacobian, weights, points, widths, layer_of, residual, damping, base, steps, same,
    handle, node, master, ratio, step,
):  # fmt: skip
    """Solve (J'J + D) step = -J' residual by preconditioned conjugate gradients.

    place     (n,) row of each entry's pixel in `residual` (m, c)
    points    (k, 4) points of segments
    widths    index of the first width among the parameters, after the coordinates of all points
    damping   (u,) D as a share of the diagonal of J'J, to which `base` is added
    step      (u,) output, for all parameters; those that follow from others are set as well
    """
    size = len(step)
    full, grad, diagonal = np.zeros(size), np.zeros(size), np.zeros(size)
    image = np.zeros(residual.shape)
    channels = weights.shape[1]
    _transposed(place, owner, jacobian, weights, points, widths, layer_of, residual, full)
    _reduce(full, same, handle, node, master, ratio, grad)
    full[:] = 0.0
    for r in range(len(place)):
        square = 0.0
        for c in range(channels):
            square += weights[r, c] ** 2
        s = owner[r]
        full[widths + layer_of[s]] += square * jacobian[r, 8] ** 2
        for k in range(4):
            q = 2 * points[s, k]
            full[q] += square * jacobian[r, 2 * k] ** 2
            full[q + 1] += square * jacobian[r, 2 * k + 1] ** 2
    for t in range(len(handle)):
        for c in range(2):
            d = full[2 * handle[t] + c]
            full[2 * node[t] + c] += (1.0 + ratio[t]) ** 2 * d
            full[2 * master[t] + c] += ratio[t] ** 2 * d
            full[2 * handle[t] + c] = 0.0
    for i in range(size):
        diagonal[same[i] if i < widths else i] += full[i]
    damp = np.empty(size)
    for i in range(0, widths, 2):
        mean = 0.5 * (diagonal[i] + diagonal[i + 1])
        for c in range(2):
            damp[i + c] = damping[i + c] * 0.5 * (diagonal[i + c] + mean) + base
    for i in range(widths, size):
        damp[i] = damping[i] * diagonal[i] + base
    r, p, product = np.empty(size), np.empty(size), np.empty(size)
    rz = 0.0
    for i in range(size):
        step[i], r[i] = 0.0, -grad[i]
        p[i] = r[i] / (diagonal[i] + damp[i])
        rz += r[i] * p[i]
    first = rz
    for _ in range(steps):
        if rz < 1e-8 * first or rz < 1e-18:
            break
        _expand(p, same, handle, node, master, ratio, full)
        image[:] = 0.0
        for e in range(len(place)):
            s = owner[e]
            move = jacobian[e, 8] * full[widths + layer_of[s]]
            for k in range(4):
                q = 2 * points[s, k]
                move += jacobian[e, 2 * k] * full[q] + jacobian[e, 2 * k + 1] * full[q + 1]
            for c in range(channels):
                image[place[e], c] += move * weights[e, c]
        _transposed(place, owner, jacobian, weights, points, widths, layer_of, image, full)
        _reduce(full, same, handle, node, master, ratio, product)
        curvature = 0.0
        for i in range(size):
            product[i] += damp[i] * p[i]
            curvature += p[i] * product[i]
        new = 0.0
        for i in range(size):
            step[i] += rz / curvature * p[i]
            r[i] -= rz / curvature * product[i]
            new += r[i] * r[i] / (diagonal[i] + damp[i])
        for i in range(size):
            p[i] = r[i] / (diagonal[i] + damp[i]) + new / rz * p[i]
        rz = new
